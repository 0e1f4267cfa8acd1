// Contacts that are presumed to stick, eliminated from a problem: what they leave to the others is a contact
// problem again (static condensation).
//
//   δ = A λ + q, A = W + ε D;   R: those that stick, δ_R = 0;   P: the others
//   λ_R = −A_RR⁻¹ (q_R + A_RP λ_P)
//   δ_P = S λ_P + q',   S = A_PP − A_PR A_RR⁻¹ A_RP,   q' = q_P − A_PR A_RR⁻¹ q_R
//
// S is symmetric and positive definite as A is. Units and shapes: as coulomb.h, three rows a contact. One
// front (front_kernels.h): the panel is [A_RR; A_PR], and S its contribution block. The factor is kept, and
// serves while W's version, ε and the lists stay. Guarantee: wait-free, no allocation after construction,
// r²(r/3 + p) + r p² flops for r and p rows. Source: Guyan 1965.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "physics/compliance/factor/front_kernels.h"
#include "physics/contact/solver/aligned_numbers.h"
#include "physics/types.h"

namespace hapticd {

struct CoulombSystem;

class StickingElimination {
 public:
  explicit StickingElimination(int contacts);

  // The lists are made anew: clear, then take every contact that is in one of them, ascending.
  void clear() noexcept;
  void take(int contact, bool sticks) noexcept;
  std::span<const int> sticking() const noexcept { return {sticking_.data(), static_cast<std::size_t>(r_)}; }
  std::span<const int> others() const noexcept { return {others_.data(), static_cast<std::size_t>(p_)}; }
  // Whether the factor is of this W and ε.
  bool kept(const CoulombSystem& system) const noexcept;
  void forget() noexcept { version_ = 0; }

  // False where A_RR is not positive definite to working precision.
  [[nodiscard]] bool factor(const CoulombSystem& system,
                            const FrontKernels& kernels = front_kernels()) noexcept;
  // Of the least to the largest pivot, small where those that stick are hyperstatic.
  double pivot_ratio() const noexcept { return pivot_ratio_; }
  double flops() const noexcept;

  // q' of the system's q and anchor, by the factor.
  void reduce(const CoulombSystem& system) noexcept;
  Eigen::Map<const MatX> S() const noexcept { return {S_.data(), 3 * p_, 3 * p_}; }
  Eigen::Map<const VecX> q() const noexcept { return {b_.data() + 3 * r_, 3 * p_}; }
  // λ of all contacts from λ_P; of those in neither list zero.
  void recover(const double* of_others, std::span<double> lambda) noexcept;

 private:
  std::vector<int> sticking_, others_;
  std::vector<int> row_;  // of W: those of R, then of P
  AlignedNumbers panel_, block_;
  std::vector<double> S_;
  std::vector<double> reciprocal_;
  std::vector<double> b_, step_;
  int r_ = 0, p_ = 0;  // contacts
  int stride_ = 0;
  double pivot_ratio_ = 1;
  std::uint64_t version_ = 0;  // of W that the factor is of; 0: none
  int contacts_ = 0;
  double epsilon_ = 0;
};

}  // namespace hapticd
