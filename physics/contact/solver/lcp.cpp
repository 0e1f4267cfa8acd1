// Block pivoting stalls where it cycles, on rigid obstacles, and from a cold start on many more rows than the
// patch has freedoms. The descent then begins from the warm set and keeps z ≥ 0; it is finite also where W is
// rank-deficient. With few active rows a fall is waited for once, because single exchanges cost little.
//
// Rounding: the answer, and each solve of the descent, has had one step of iterative refinement. What counts
// as infeasible is beyond rounding: of w, that of its sums; of z, that of its largest entry, though in W's
// null space z is known to ε⁻¹ times that only. An entry that is negative by less is open, not cut, or w
// would move by as much.
#include "physics/contact/solver/lcp.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "physics/contact/solver/small_factors.h"

namespace hapticd {
namespace {

constexpr double unit_roundoff = std::numeric_limits<double>::epsilon();
constexpr double least_diagonal = 1e-12;  // of the largest: keeps 1/D finite where W_ii = 0
constexpr int few = 24;                   // active rows, whose single exchanges are cheap

class Pivoting {
 public:
  Pivoting(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q, Eigen::Ref<VecX> z,
           std::span<std::uint8_t> active, LcpWorkspace& ws, double epsilon,
           const ColumnsOnDemand& columns) noexcept
      : W_(W),
        q_(q),
        z_(z),
        active_(active),
        ws_(ws),
        n_(static_cast<int>(q.size())),
        epsilon_(epsilon),
        columns_(columns) {
    double largest = 0;
    for (int i = 0; i < n_; ++i) largest = std::max(largest, W_(i, i));
    for (int i = 0; i < n_; ++i) {
      ws_.diagonal[i] = std::max(W_(i, i), least_diagonal * largest);
      ws_.root[i] = std::sqrt(ws_.diagonal[i]);
      // An open gap asks for no force; where W_ii is near 0 it would ask for one beyond all others.
      q_scale_ = std::max(q_scale_, -q_[i] / ws_.diagonal[i]);
    }
    rigid_ = largest <= 0;
  }

  bool rigid() const noexcept { return rigid_; }
  int active() const noexcept { return size_; }

  // z for the present active set, w of all rows.
  void solve_active_block(std::uint64_t version) noexcept {
    factor(version);
    z_.setZero();
    w() = q_;
    refine();
  }

  // z_F −= (W + εD)_FF⁻¹ w_F, and w follows.
  void refine() noexcept {
    size_ = 0;
    for (int i = 0; i < n_; ++i)
      if (active_[i]) ws_.packed[size_++] = -ws_.w[i];
    cholesky_solve(ws_.factor.data(), size_, ws_.packed.data());
    for (int k = 0; k < size_; ++k) z_[ws_.index[k]] += ws_.packed[k];
    compute_w();
  }

  // w = (W + εD) z + q.
  void compute_w() noexcept {
    w() = q_;
    for (int j = 0; j < n_; ++j) add_column(j, z_[j]);
  }

  double natural_map() const noexcept {
    double scale = q_scale_, worst = 0;
    for (int i = 0; i < n_; ++i) {
      if (!std::isfinite(ws_.w[i])) return std::numeric_limits<double>::infinity();
      scale = std::max(scale, z_[i]);
      worst = std::max(worst, std::abs(std::min(z_[i], ws_.w[i] / ws_.diagonal[i])));
    }
    return worst > 0 ? worst / scale : 0;
  }

  // Marks the infeasible indices in ws.packed (1 or 0) and returns how many.
  int find_infeasible() noexcept {
    const double z_noise = this->z_noise(), weighted = weighted_sum();
    int count = 0;
    for (int i = 0; i < n_; ++i) {
      const bool bad = active_[i] ? z_[i] < -z_noise : ws_.w[i] < -w_noise(i, weighted);
      ws_.packed[i] = bad;
      count += bad;
    }
    return count;
  }

  // The least feasible inactive row, relative to its diagonal; −1: none. Blocked rows are passed over.
  int most_violated() const noexcept {
    const double weighted = weighted_sum();
    int worst = -1;
    double least = 0;
    for (int i = 0; i < n_; ++i) {
      if (ws_.w[i] >= 0 || active_[i] || ws_.blocked[i] || ws_.w[i] >= -w_noise(i, weighted)) continue;
      if (ws_.w[i] / ws_.root[i] >= least) continue;
      least = ws_.w[i] / ws_.root[i];
      worst = i;
    }
    return worst;
  }

  // From the feasible point in ws.best as far towards z as no entry turns negative; the entries that
  // stop it leave the active set. True: z itself was feasible (to its noise).
  bool step_towards() noexcept {
    const double noise = z_noise();
    double reach = 1;
    for (int i = 0; i < n_; ++i)
      if (active_[i] && z_[i] < -noise) reach = std::min(reach, ws_.best[i] / (ws_.best[i] - z_[i]));
    if (reach == 1) {
      for (int i = 0; i < n_; ++i) ws_.best[i] = std::max(0.0, z_[i]);
      return true;
    }
    for (int i = 0; i < n_; ++i) {
      if (!active_[i]) continue;
      const bool stops = z_[i] < -noise && ws_.best[i] / (ws_.best[i] - z_[i]) <= reach;
      ws_.best[i] = stops ? 0 : std::max(0.0, ws_.best[i] + reach * (z_[i] - ws_.best[i]));
      if (stops) active_[i] = 0;
    }
    return false;
  }

  void start_from_feasible(std::span<const std::uint8_t> set) noexcept {
    std::copy(set.begin(), set.end(), active_.begin());
    std::fill_n(ws_.best.data(), n_, 0.0);
    std::fill_n(ws_.blocked.data(), n_, std::uint8_t{0});
  }

  bool finite() const noexcept { return z_.allFinite(); }
  bool refused(int i) const noexcept { return !(z_[i] > 0); }
  void enter(int i) noexcept { active_[i] = 1; }
  void block(int i) noexcept {
    active_[i] = 0;
    ws_.blocked[i] = 1;
  }
  void unblock() noexcept { std::fill_n(ws_.blocked.data(), n_, std::uint8_t{0}); }

  void exchange_infeasible() noexcept {
    for (int i = 0; i < n_; ++i)
      if (ws_.packed[i] != 0) active_[i] = !active_[i];
  }

  void keep_best() noexcept { std::copy_n(z_.data(), n_, ws_.best.data()); }
  void restore_best() noexcept { std::copy_n(ws_.best.data(), n_, z_.data()); }

 private:
  Eigen::Map<VecX> w() noexcept { return {ws_.w.data(), n_}; }
  double z_noise() const noexcept { return 4 * unit_roundoff * z_.cwiseAbs().maxCoeff(); }

  // |Σ_j W_ij z_j| ≤ √W_ii Σ_j √W_jj |z_j| for a positive semidefinite W; `weighted` is the last sum.
  double weighted_sum() const noexcept {
    return Eigen::Map<const VecX>(ws_.root.data(), n_).dot(z_.cwiseAbs());
  }
  double w_noise(int i, double weighted) const noexcept {
    return 8 * unit_roundoff * (ws_.root[i] * weighted + std::abs(q_[i]));
  }

  void add_column(int j, double zj) noexcept {
    if (zj == 0) return;
    columns_.ask(j);
    const double* column = W_.data() + static_cast<std::ptrdiff_t>(j) * W_.outerStride();
    for (int i = 0; i < n_; ++i) ws_.w[i] += zj * column[i];
    ws_.w[j] += epsilon_ * ws_.diagonal[j] * zj;
  }

  void factor(std::uint64_t version) noexcept {
    const bool same = version != 0 && version == ws_.cached_version && n_ == ws_.cached_rows &&
                      std::equal(active_.begin(), active_.end(), ws_.cached_set.begin());
    if (same) return;
    size_ = 0;
    for (int i = 0; i < n_; ++i)
      if (active_[i]) ws_.index[size_++] = i;
    for (int j = 0; j < size_; ++j) columns_.ask(ws_.index[j]);
    const int ld = padded(size_);
    for (int j = 0; j < size_; ++j) {
      double* out = ws_.factor.data() + static_cast<std::ptrdiff_t>(j) * ld;
      const double* column = W_.data() + static_cast<std::ptrdiff_t>(ws_.index[j]) * W_.outerStride();
      for (int i = j; i < size_; ++i) out[i] = column[ws_.index[i]];
      std::fill(out + size_, out + ld, 0.0);
      out[j] = W_(ws_.index[j], ws_.index[j]) + epsilon_ * ws_.diagonal[ws_.index[j]];
    }
    cholesky(ws_.factor.data(), size_, std::max(0.25 * epsilon_, unit_roundoff));
    std::copy(active_.begin(), active_.end(), ws_.cached_set.begin());
    ws_.cached_version = version;
    ws_.cached_rows = n_;
  }

  const Eigen::Ref<const MatX>& W_;
  const Eigen::Ref<const VecX>& q_;
  Eigen::Ref<VecX> z_;
  std::span<std::uint8_t> active_;
  LcpWorkspace& ws_;
  int n_;
  double epsilon_;
  const ColumnsOnDemand& columns_;
  double q_scale_ = 0;
  int size_ = 0;
  bool rigid_ = false;
};

enum class Outcome : std::uint8_t { solved, stalled, capped, late, not_finite };

// Block principal pivoting: solved, or stalled where the infeasible indices no longer become fewer.
Outcome exchange_blocks(Pivoting& p, std::uint64_t version, const LcpOptions& options, int& pivots) noexcept {
  int fewest = std::numeric_limits<int>::max(), in_vain = 0;
  for (;;) {
    p.solve_active_block(version);
    if (!p.finite()) return Outcome::not_finite;
    int infeasible = p.find_infeasible();
    if (infeasible == 0) {
      p.refine();
      if (!p.finite()) return Outcome::not_finite;
      infeasible = p.find_infeasible();
    }
    if (infeasible == 0) {
      p.keep_best();
      return Outcome::solved;
    }
    if (infeasible < fewest) {
      fewest = infeasible;
      in_vain = 0;
    } else if (in_vain++ >= (p.active() > few ? options.patience : options.patience_with_few)) {
      return Outcome::stalled;
    }
    if (options.deadline.passed()) {
      p.keep_best();
      return Outcome::late;
    }
    if (pivots >= options.max_pivots) return Outcome::stalled;
    ++pivots;
    p.exchange_infeasible();
  }
}

// Single exchanges that never leave z ≥ 0 and always lower ½ zᵀAz + qᵀz. A row whose entry its own
// solve refuses (rounding) is blocked until the next descent.
Outcome descend(Pivoting& p, std::uint64_t version, const LcpOptions& options, int& pivots) noexcept {
  const int limit = pivots + options.max_pivots;
  for (int entered = -1;;) {
    if (options.deadline.passed()) return Outcome::late;
    p.solve_active_block(version);
    p.refine();
    if (!p.finite()) return Outcome::not_finite;
    if (entered >= 0 && p.refused(entered)) {
      p.block(entered);
    } else {
      if (!p.step_towards()) {
        entered = -1;
        if (++pivots >= limit) return Outcome::capped;
        continue;
      }
      p.unblock();
    }
    p.restore_best();
    p.compute_w();
    entered = p.most_violated();
    if (entered < 0) return Outcome::solved;
    if (++pivots >= limit) return Outcome::capped;
    p.enter(entered);
  }
}

int count_active(std::span<const std::uint8_t> active) noexcept {
  return static_cast<int>(std::count_if(active.begin(), active.end(), [](auto a) { return a != 0; }));
}

}  // namespace

LcpWorkspace::LcpWorkspace(int rows)
    : capacity(rows),
      factor(static_cast<std::size_t>(padded(rows)) * static_cast<std::size_t>(rows)),
      index(rows),
      diagonal(rows),
      root(rows),
      packed(rows),
      w(rows),
      best(rows),
      warm_set(rows),
      blocked(rows),
      cached_set(rows) {}

// Sums of 0 · w, which are 0 or NaN: many at once, or each would wait for the one before.
bool all_finite(const Eigen::Ref<const MatX>& W, std::uint64_t version, std::uint64_t& known) noexcept {
  constexpr Eigen::Index abreast = 16;
  if (version != 0 && version == known) return true;
  std::array<double, abreast> sum{};
  for (Eigen::Index j = 0; j < W.cols(); ++j) {
    const double* const column = W.data() + j * W.outerStride();
    Eigen::Index k = 0;
    for (; k + abreast <= W.rows(); k += abreast)
      for (Eigen::Index l = 0; l < abreast; ++l) sum[static_cast<std::size_t>(l)] += 0 * column[k + l];
    for (; k < W.rows(); ++k) sum[0] += 0 * column[k];
  }
  const bool finite = std::all_of(sum.begin(), sum.end(), [](double s) { return s == 0; });
  known = finite ? version : 0;
  return finite;
}

LcpResult solve_lcp(const Eigen::Ref<const MatX>& W, const Eigen::Ref<const VecX>& q, Eigen::Ref<VecX> z,
                    std::span<std::uint8_t> active, LcpWorkspace& workspace, std::uint64_t matrix_version,
                    const LcpOptions& options) noexcept {
  LcpResult result;
  const auto refuse = [&](SolveStatus status) {
    z.setZero();
    std::fill(active.begin(), active.end(), std::uint8_t{0});
    workspace.cached_version = 0;
    result.status = status;
    result.active = 0;
    return result;
  };
  if (q.size() > workspace.capacity) return refuse(SolveStatus::too_large);
  const bool finite = options.columns.make ? W.diagonal().allFinite()
                                           : all_finite(W, matrix_version, workspace.finite_version);
  if (!q.allFinite() || !finite) return refuse(SolveStatus::not_finite);

  Pivoting pivoting(W, q, z, active, workspace, options.relative_diagonal, options.columns);
  if (pivoting.rigid()) {
    const bool feasible = q.size() == 0 || q.minCoeff() >= 0;
    result.residual = feasible ? 0 : 1;
    return refuse(feasible ? SolveStatus::solved : SolveStatus::iteration_cap);
  }

  std::copy(active.begin(), active.end(), workspace.warm_set.begin());
  Outcome outcome = exchange_blocks(pivoting, matrix_version, options, result.pivots);
  if (outcome == Outcome::stalled) {
    result.fell_back = true;
    pivoting.start_from_feasible({workspace.warm_set.data(), active.size()});
    outcome = descend(pivoting, matrix_version, options, result.pivots);
  }
  if (outcome == Outcome::not_finite) return refuse(SolveStatus::not_finite);
  if (outcome == Outcome::capped) result.status = SolveStatus::iteration_cap;
  if (outcome == Outcome::late) result.status = SolveStatus::deadline;

  pivoting.restore_best();
  z = z.cwiseMax(0.0);
  pivoting.compute_w();
  result.residual = pivoting.natural_map();
  if (!z.allFinite() || !std::isfinite(result.residual)) return refuse(SolveStatus::not_finite);
  if (result.status == SolveStatus::solved && result.residual > options.tolerance)
    result.status = SolveStatus::iteration_cap;
  result.active = count_active(active);
  return result;
}

}  // namespace hapticd
