// A supernodal Cholesky factor of the system matrix, P A Pᵀ = L Lᵀ, that is renewed in place every step.
//
// The matrix is written into CHOLMOD's lower triangle already permuted, so a refactorisation neither permutes
// nor sorts; CHOLMOD keeps the given order and does not postorder (that would tear the zone apart).
// Supernodes are amalgamated with nrelax = 8/32/96, zrelax = .8/.2/.05, and CHOLMOD is kept from starting
// OpenMP threads; README.md has what either is worth.
// Shapes: vectors of 3·nodes in the order's places, `place()` of a node; units as the matrix's.
// Errors: `set_order` throws std::runtime_error when the analysis fails, `factor` when A is not positive
// definite (or so nearly singular, rcond < 1e-15, that nothing of a solution would be right).
#pragma once

#include <cholmod.h>

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "physics/compliance/system_matrix.h"

namespace hapticd {

// Keeps CHOLMOD's OpenMP regions on the calling thread; for every thread that calls CHOLMOD.
void forbid_openmp_threads() noexcept;

class CholmodFactor {
 public:
  CholmodFactor();
  ~CholmodFactor();
  CholmodFactor(const CholmodFactor&) = delete;
  CholmodFactor& operator=(const CholmodFactor&) = delete;

  // Symbolic analysis of the matrix's pattern with this elimination order. `live_edges`: which edges may have
  // values from now on (SystemMatrix::live_edges), so that tissue that is gone costs nothing; empty: all.
  void set_order(const SystemMatrix& matrix, std::span<const int> order,
                 std::span<const std::uint8_t> live_edges = {});

  // Numeric factorisation of the matrix as it is assembled now.
  void factor(const SystemMatrix& matrix);

  int place(int node) const noexcept { return place_[node]; }
  const cholmod_factor& cholmod() const noexcept { return *L_; }
  std::size_t memory_bytes() const noexcept;  // of the factor's values and indices

  // The right-hand side and, after `solve`, the solution.
  Eigen::Map<VecX> vector() noexcept {
    return {static_cast<double*>(x_->x), static_cast<Eigen::Index>(x_->nrow)};
  }
  void solve();

  // Y = L⁻¹ E, 3·nodes rows and three columns for each of these places. Allocates.
  void half_solve(std::span<const int> places, MatX& Y);

  // The trailing corner of L: rows and columns of the last `nodes` nodes, strict upper triangle zero.
  void trailing_corner(int nodes, MatX& corner) const;

 private:
  void free_all() noexcept;

  // Where a coupling block goes: its three columns' first entries, and whether it is stored transposed.
  struct Target {
    std::array<int, 3> column = {-1, -1, -1};  // of the edge's values; -1: not in the pattern
    bool transposed = false;
  };

  cholmod_common common_;
  cholmod_sparse* A_ = nullptr;
  cholmod_factor* L_ = nullptr;
  cholmod_dense* x_ = nullptr;
  cholmod_dense* work_ = nullptr;
  std::vector<int> place_;
  std::vector<Target> target_;  // per edge
};

}  // namespace hapticd
