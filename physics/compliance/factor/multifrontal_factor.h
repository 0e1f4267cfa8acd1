// A multifrontal Cholesky factor of the system matrix, P A Pᵀ = L Lᵀ, that is renewed in place every step.
//
//   front = A's columns + Σ_children contribution block;   [L11; L21] = its panel factored;   contribution
//   block = F22 − L21 L21ᵀ
//
// Three times as fast as CHOLMOD at the paper's size (README.md): the symbolic work is done on 3×3 blocks and
// once, small fronts are merged by a model of time, nothing is allocated, and the kernels are compiled for
// the processor's widest vectors. The interface is CholmodFactor's, which stays as oracle and fallback. The
// order inside the rest may be changed for contiguous fronts, so `place` is to be asked after `set_order`;
// the zone's nodes keep the last places in the order given. Shapes: vectors of 3·nodes in the order's places;
// units as the matrix's. Guarantee: `factor` and `solve` allocate nothing. Errors: `factor` throws
// std::runtime_error when A is not positive definite (a pivot ≤ 0, or so nearly singular, (least / largest
// L_jj)² ≤ 1e-15, that nothing of a solution would be right).
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "physics/compliance/factor/front_kernels.h"
#include "physics/compliance/factor/front_plan.h"
#include "physics/compliance/factor/page_memory.h"
#include "physics/compliance/system_matrix.h"

namespace hapticd {

class MultifrontalFactor {
 public:
  // Others than the processor's best are for tests.
  explicit MultifrontalFactor(const FrontKernels& kernels = front_kernels()) : kernels_(&kernels) {}

  // `live_edges` as CholmodFactor::set_order; the order's last `zone` nodes are factored as dense blocks.
  void set_order(const SystemMatrix& matrix, std::span<const int> order,
                 std::span<const std::uint8_t> live_edges, int zone,
                 ZoneFronts zone_fronts = ZoneFronts::one);

  void factor(const SystemMatrix& matrix);

  // All but the last `nodes` nodes b, which `set_order` was given as its zone, are eliminated:
  // S = A_bb − A_bf A_ff⁻¹ A_fb. Of the rest of this class only these are then to be used:
  // reduce: x_b ← x_b − A_bf A_ff⁻¹ x_f;   extend: x_f ← −A_ff⁻¹ A_fb x_b. Allocates.
  void condense(const SystemMatrix& matrix, int nodes, MatX& S);
  void reduce() noexcept;
  void extend() noexcept;

  int place(int node) const noexcept { return plan_.place[node]; }
  std::size_t memory_bytes() const noexcept;  // of values, workspace and indices

  const FrontPlan& plan() const noexcept { return plan_; }
  // The panels of L, as the plan lays them out. The factor is nothing afterwards.
  PageMemory take_values() noexcept { return std::move(values_); }
  // Memory of a factor that is no more, before `set_order`: to map and clear as much costs a tenth of a
  // factor.
  PageMemory take_workspace() noexcept { return std::move(workspace_); }
  void give_memory(PageMemory values, PageMemory workspace) noexcept {
    values_ = std::move(values);
    workspace_ = std::move(workspace);
  }

  // The right-hand side and, after `solve`, the solution.
  Eigen::Map<VecX> vector() noexcept { return {x_.data(), x_.size()}; }
  void solve() noexcept;

  // Y = L⁻¹ E, 3·nodes rows and three columns for each of these places. Allocates.
  void half_solve(std::span<const int> places, MatX& Y);

  // The trailing corner of L: rows and columns of the last `nodes` nodes, strict upper triangle zero.
  void trailing_corner(int nodes, MatX& corner) const;
  // Its places from which on no node is coupled with those before, if it is made of the zone's fronts.
  std::vector<int> corner_pieces(int nodes) const;

 private:
  bool eliminate(const SystemMatrix& matrix, int kept);
  void forward(const FrontPlan::Front& front) noexcept;
  void backward(const FrontPlan::Front& front) noexcept;
  void assemble(const SystemMatrix& matrix, std::size_t front) noexcept;
  void add_child(int child, int begin, int end, double* target, std::ptrdiff_t stride) noexcept;

  const FrontKernels* kernels_;
  FrontPlan plan_;
  PageMemory values_;
  PageMemory workspace_;
  std::vector<double> reciprocal_;  // of the diagonal of L
  std::vector<double> gathered_;
  std::vector<std::uint8_t> reached_;  // fronts, in a half solve
  MatX below_;
  int kept_ = 0;  // unknowns of the last front that `condense` left
  VecX x_;
};

}  // namespace hapticd
