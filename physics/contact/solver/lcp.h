// Frictionless contact: a linear complementarity problem by block principal pivoting.
//
//   w = (W + ε D) z + q,   0 ≤ w ⟂ z ≥ 0,   D = diag(W),  ε = relative_diagonal
//
// Block pivoting (Júdice and Pires 1994) exchanges all infeasible indices while their number falls, at most
// `patience` times without a fall. Where that stalls, single exchanges lower ½ zᵀ(W + εD)z + qᵀz each time,
// which is finite because W + εD is positive definite (Lawson and Hanson 1974, ch. 23). Departure: not
// Murty's least-index rule, which takes more than 1000 pivots on 64 sample points of 20 surface nodes. Warm
// start: the active set handed in `active`. The Cholesky factor of the active block is cached in the
// workspace while neither W (by `matrix_version`) nor the set changes.
// Units: W [m/N], q [m], z [N]. z is never negative; entries with W_ii = 0 that W couples to nothing stay at
// zero. Errors: a status, never an exception, and of the z returned: with `iteration_cap` z is the last
// feasible iterate, with `deadline` that or the last one with its negative entries cut, with `not_finite`
// (NaN or infinity in W, q or w) and `too_large` (more rows than the workspace was made for) it is zero.
// Guarantee: no allocation, wait-free, bounded by 2 max_pivots factorisations of active³/3 flops.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "physics/contact/condensed_problem.h"
#include "physics/contact/solver/deadline.h"
#include "physics/contact/solver/small_factors.h"

namespace hapticd {

enum class SolveStatus : std::uint8_t { solved, iteration_cap, deadline, not_finite, too_large };

// No entry of W's lower triangle is NaN or infinite; asked once for each nonzero version, which `known`
// remembers.
bool all_finite(const Eigen::Ref<const MatX>& W, std::uint64_t version, std::uint64_t& known) noexcept;

// Who makes W's columns as they are asked for (delassus_columns.h). Before that W has its diagonal's blocks
// alone.
struct ColumnsOnDemand {
  void (*make)(void* maker, int contact) noexcept = nullptr;  // null: all of W is there
  void* maker = nullptr;

  void ask(int contact) const noexcept {
    if (make) make(maker, contact);
  }
};

struct LcpOptions {
  double tolerance = 1e-8;  // on the residual: above it, as where W is indefinite, nothing is `solved`
  double relative_diagonal = 1e-9;
  int patience = 5;           // exchanges of blocks in vain
  int patience_with_few = 1;  // … with at most 24 active rows
  int max_pivots = 1000;      // of either kind
  Deadline deadline;          // looked at before each pivot
  ColumnsOnDemand columns;    // a contact is a row
};

struct LcpResult {
  SolveStatus status = SolveStatus::solved;
  int pivots = 0;          // changes of the active set
  bool fell_back = false;  // the descent by single exchanges was needed
  int active = 0;
  double residual = 0;  // max_i |min(z_i, w_i / W_ii)| / max(max_i z_i, max_i −q_i / W_ii): natural map
};

// One owner. Made for so many rows at the most, and allocated then.
struct LcpWorkspace {
  explicit LcpWorkspace(int rows = max_rows);

  int capacity;                  // rows
  std::vector<double> factor;    // ld: padded(active)
  std::vector<int> index;        // active rows, ascending: the factor's order
  std::vector<double> diagonal;  // D, floored
  std::vector<double> root;      // √D
  std::vector<double> packed;    // a right-hand side in the factor's order
  std::vector<double> w;
  std::vector<double> best;
  std::vector<std::uint8_t> warm_set;
  std::vector<std::uint8_t> blocked;
  std::vector<std::uint8_t> cached_set;
  std::uint64_t cached_version = 0;  // 0: nothing cached
  int cached_rows = 0;
  std::uint64_t finite_version = 0;  // of the last W that was seen to be finite; 0: none
};

// z and active have n entries; active is read as warm start and left as the solution's active set.
// matrix_version: equal nonzero values promise an unchanged W; 0: W is new.
LcpResult solve_lcp(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q, Eigen::Ref<VecX> z,
                    std::span<std::uint8_t> active, LcpWorkspace& workspace, std::uint64_t matrix_version,
                    const LcpOptions& options) noexcept;

}  // namespace hapticd
