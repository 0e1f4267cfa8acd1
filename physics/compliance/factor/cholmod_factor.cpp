#include "physics/compliance/factor/cholmod_factor.h"

#include <dlfcn.h>

#include <algorithm>
#include <stdexcept>

namespace hapticd {

// CHOLMOD opens OpenMP regions of a fixed four threads for each supernode, whatever OMP_NUM_THREADS says: at
// the paper's size that is 12 ms instead of 5, and three more threads beside the haptic one. Zero active
// levels runs every region on the caller. The setting belongs to the calling thread, so each factorisation
// and solve makes it. Looked up by name because nothing else here needs OpenMP's library.
void forbid_openmp_threads() noexcept {
  using SetLevels = void (*)(int);
  static const auto set_max_active_levels =
      reinterpret_cast<SetLevels>(dlsym(RTLD_DEFAULT, "omp_set_max_active_levels"));
  if (set_max_active_levels) set_max_active_levels(0);
}

CholmodFactor::CholmodFactor() {
  cholmod_start(&common_);
  common_.print = 0;
  common_.nmethods = 1;
  common_.method[0].ordering = CHOLMOD_NATURAL;
  common_.postorder = 0;
  common_.supernodal = CHOLMOD_SUPERNODAL;
  common_.final_ll = 1;
  common_.quick_return_if_not_posdef = 1;
  const std::size_t nrelax[3] = {8, 32, 96};
  const double zrelax[3] = {0.8, 0.2, 0.05};
  std::copy(nrelax, nrelax + 3, common_.nrelax);
  std::copy(zrelax, zrelax + 3, common_.zrelax);
}

CholmodFactor::~CholmodFactor() {
  free_all();
  cholmod_finish(&common_);
}

void CholmodFactor::free_all() noexcept {
  cholmod_free_factor(&L_, &common_);
  cholmod_free_sparse(&A_, &common_);
  cholmod_free_dense(&x_, &common_);
  cholmod_free_dense(&work_, &common_);
}

void CholmodFactor::set_order(const SystemMatrix& matrix, std::span<const int> order,
                              std::span<const std::uint8_t> live_edges) {
  const int nodes = matrix.node_count();
  place_.resize(nodes);
  for (int k = 0; k < nodes; ++k) place_[order[k]] = k;

  // Below each node's diagonal block: the edges to nodes of later places, by place.
  struct Below {
    int place;
    int edge;
  };
  const auto& edges = matrix.edges();
  std::vector<std::vector<Below>> below(nodes);
  for (int e = 0; e < static_cast<int>(edges.size()); ++e) {
    if (!live_edges.empty() && !live_edges[e]) continue;
    const int i = place_[edges[e].i];
    const int j = place_[edges[e].j];
    below[std::min(i, j)].push_back({std::max(i, j), e});
  }

  free_all();
  const std::size_t dofs = static_cast<std::size_t>(3) * nodes;
  A_ = cholmod_allocate_sparse(dofs, dofs, 9 * edges.size() + 6 * static_cast<std::size_t>(nodes), 1, 1, -1,
                               CHOLMOD_REAL, &common_);
  if (!A_) throw std::runtime_error("CHOLMOD could not allocate the system matrix");
  int* start = static_cast<int*>(A_->p);
  int* row = static_cast<int*>(A_->i);
  target_.assign(edges.size(), Target{});
  int next = 0;
  for (int k = 0; k < nodes; ++k) {
    std::sort(below[k].begin(), below[k].end(),
              [](const Below& a, const Below& b) { return a.place < b.place; });
    for (int c = 0; c < 3; ++c) {
      start[3 * k + c] = next;
      for (int r = c; r < 3; ++r) row[next++] = 3 * k + r;
      for (const Below& b : below[k]) {
        Target& target = target_[b.edge];
        target.column[c] = next;
        // The edge's block has rows of i: as it is where i is eliminated later than j.
        target.transposed = place_[edges[b.edge].i] == k;
        for (int r = 0; r < 3; ++r) row[next++] = 3 * b.place + r;
      }
    }
  }
  start[3 * nodes] = next;

  L_ = cholmod_analyze(A_, &common_);
  if (!L_ || !L_->is_super) throw std::runtime_error("CHOLMOD could not analyse the system matrix");
  x_ = cholmod_zeros(dofs, 1, CHOLMOD_REAL, &common_);
  work_ = cholmod_zeros(std::max<std::size_t>(L_->maxesize, 1), 1, CHOLMOD_REAL, &common_);
  if (!x_ || !work_) throw std::runtime_error("CHOLMOD could not allocate its workspace");
}

void CholmodFactor::factor(const SystemMatrix& matrix) {
  forbid_openmp_threads();
  double* value = static_cast<double*>(A_->x);
  const int* start = static_cast<const int*>(A_->p);
  for (int n = 0; n < matrix.node_count(); ++n)
    for (int c = 0; c < 3; ++c)
      for (int r = c; r < 3; ++r) value[start[3 * place_[n] + c] + r - c] = matrix.diagonal()[n](r, c);
  for (std::size_t e = 0; e < target_.size(); ++e) {
    const Mat3& block = matrix.coupling()[e];
    const Target& target = target_[e];
    if (target.column[0] < 0) continue;
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) value[target.column[c] + r] = target.transposed ? block(c, r) : block(r, c);
  }
  const bool done = cholmod_factorize(A_, L_, &common_) && common_.status == CHOLMOD_OK && L_->minor == L_->n;
  if (!done || !(cholmod_rcond(L_, &common_) > 1e-15))
    throw std::runtime_error(
        "the system matrix A is not positive definite: a body (or a part cut from it) "
        "has neither mass nor support");
}

void CholmodFactor::solve() {
  forbid_openmp_threads();
  if (!cholmod_super_lsolve(L_, x_, work_, &common_) || !cholmod_super_ltsolve(L_, x_, work_, &common_))
    throw std::runtime_error("CHOLMOD could not solve with the factor");
}

void CholmodFactor::half_solve(std::span<const int> places, MatX& Y) {
  forbid_openmp_threads();
  const auto rows = static_cast<Eigen::Index>(L_->n), columns = static_cast<Eigen::Index>(3 * places.size());
  Y.setZero(rows, columns);
  for (std::size_t k = 0; k < places.size(); ++k)
    Y.block<3, 3>(3 * places[k], static_cast<Eigen::Index>(3 * k)).setIdentity();
  MatX work(static_cast<Eigen::Index>(std::max<std::size_t>(L_->maxesize, 1)), columns);
  const auto dense = [](MatX& m) {
    cholmod_dense d{};
    d.nrow = d.d = static_cast<std::size_t>(m.rows());
    d.ncol = static_cast<std::size_t>(m.cols());
    d.nzmax = static_cast<std::size_t>(m.size());
    d.x = m.data();
    d.xtype = CHOLMOD_REAL;
    d.dtype = CHOLMOD_DOUBLE;
    return d;
  };
  cholmod_dense y = dense(Y), w = dense(work);
  if (!cholmod_super_lsolve(L_, &y, &w, &common_))
    throw std::runtime_error("CHOLMOD could not solve with the factor");
}

std::size_t CholmodFactor::memory_bytes() const noexcept {
  return L_ ? L_->xsize * sizeof(double) + (L_->ssize + 3 * L_->nsuper + L_->n) * sizeof(int) : 0;
}

void CholmodFactor::trailing_corner(int nodes, MatX& corner) const {
  const int size = 3 * nodes;
  const int first = static_cast<int>(L_->n) - size;
  corner.setZero(size, size);
  const int* super = static_cast<const int*>(L_->super);
  const int* row_start = static_cast<const int*>(L_->pi);
  const int* value_start = static_cast<const int*>(L_->px);
  const int* rows = static_cast<const int*>(L_->s);
  const double* values = static_cast<const double*>(L_->x);
  // The zone may span several supernodes, and the first of them may begin before the zone.
  for (int s = static_cast<int>(L_->nsuper) - 1; s >= 0 && super[s + 1] > first; --s) {
    const int* row = rows + row_start[s];
    const int height = row_start[s + 1] - row_start[s];
    for (int j = std::max(first, super[s]); j < super[s + 1]; ++j) {
      const double* column = values + value_start[s] + static_cast<std::ptrdiff_t>(j - super[s]) * height;
      for (int k = j - super[s]; k < height; ++k) corner(row[k] - first, j - first) = column[k];
    }
  }
}

}  // namespace hapticd
