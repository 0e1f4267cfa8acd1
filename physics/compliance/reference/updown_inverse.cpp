// L D Lᵀ kept current by CHOLMOD's Modify module: the established method.
//
//   L D Lᵀ ← L D Lᵀ − V Vᵀ, exactly;   C_pp = Xᵀ D⁻¹ X,   X = L⁻¹ Eₚ
//
// A change touches the columns on the paths from V's rows to the root of the elimination tree: with the
// zone last, a hole in the zone touches the trailing corner only, whatever the size of the body. The factor
// is made by supernodes and then turned into simplicial L D Lᵀ (simplicial factorisation takes ten times
// longer). Its columns hold the pattern of the whole body, so no change ever needs room.
// Source: Davis and Hager, "Row modifications of a sparse Cholesky factorization", and their update papers.
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "physics/compliance/factor/cholmod_factor.h"
#include "physics/compliance/patch_inverse.h"
#include "physics/compliance/reference/low_rank_inverse.h"

namespace hapticd {

namespace {

class UpdownInverse final : public LowRankInverse {
 public:
  UpdownInverse(const SystemMatrix& A, std::span<const int> order, std::span<const int> zone)
      : zone_size_(static_cast<int>(zone.size())), node_(order.begin(), order.end()), place_(order.size()) {
    for (int k = 0; k < static_cast<int>(order.size()); ++k) place_[order[k]] = k;
    cholmod_start(&common_);
    common_.print = 0;
    CholmodFactor supernodal;
    supernodal.set_order(A, order);
    supernodal.factor(A);
    L_ = cholmod_copy_factor(const_cast<cholmod_factor*>(&supernodal.cholmod()), &common_);
    if (!L_ || !cholmod_change_factor(CHOLMOD_REAL, 0, 0, 0, 1, L_, &common_)) {
      release();
      throw std::runtime_error("CHOLMOD could not turn the factor into L D Lᵀ");
    }
    b_ = cholmod_zeros(L_->n, 1, CHOLMOD_REAL, &common_);
    if (!b_) {
      release();
      throw std::runtime_error("CHOLMOD could not allocate a right-hand side");
    }
  }

  ~UpdownInverse() override { release(); }
  UpdownInverse(const UpdownInverse&) = delete;
  UpdownInverse& operator=(const UpdownInverse&) = delete;

  bool change(const ElementTerm& term, TermSign sign) override {
    forbid_openmp_threads();
    // Columns of V as a packed sparse matrix, rows in the factor's order; corners come by place.
    int start[13];
    int row[144];
    double value[144];
    int next = 0;
    int first = static_cast<int>(L_->n);
    for (int k = 0; k < term.rank; ++k) {
      start[k] = next;
      for (int i = 0; i < 3 * term.corners; ++i) {
        if (term.V(i, k) == 0) continue;
        row[next] = 3 * place_[term.node[i / 3]] + i % 3;
        first = std::min(first, row[next]);
        value[next++] = term.V(i, k);
      }
    }
    start[term.rank] = next;
    cholmod_sparse V{};
    V.nrow = L_->n;
    V.ncol = static_cast<std::size_t>(term.rank);
    V.nzmax = static_cast<std::size_t>(next);
    V.p = start;
    V.i = row;
    V.x = value;
    V.itype = CHOLMOD_INT;
    V.xtype = CHOLMOD_REAL;
    V.dtype = CHOLMOD_DOUBLE;
    V.sorted = V.packed = 1;
    corner_is_current_ = false;
    if (next == 0) return true;  // all corners fixed
    if (!cholmod_updown(sign == TermSign::add, &V, L_, &common_) || common_.status != CHOLMOD_OK)
      return false;
    // Only the pivots on the paths have changed, and the paths of an element's corners are one.
    for (int j = first; j >= 0; j = parent(j))
      if (!(D(j) > 0) || !std::isfinite(D(j))) return false;
    return true;
  }

  int place(int node) const override { return place_[node]; }

  void apply(VecX& x) override {
    forbid_openmp_threads();
    double* b = static_cast<double*>(b_->x);
    for (std::size_t k = 0; k < node_.size(); ++k)
      for (int r = 0; r < 3; ++r) b[3 * k + r] = x[3 * node_[k] + r];
    if (!cholmod_solve2(CHOLMOD_LDLt, L_, b_, nullptr, &x_, nullptr, &y_, &e_, &common_))
      throw std::runtime_error("CHOLMOD could not solve with the factor");
    const double* y = static_cast<const double*>(x_->x);
    for (std::size_t k = 0; k < node_.size(); ++k)
      for (int r = 0; r < 3; ++r) x[3 * node_[k] + r] = y[3 * k + r];
  }

  void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) override {
    const int zone_start = static_cast<int>(node_.size()) - zone_size_;
    if (std::all_of(nodes.begin(), nodes.end(), [&](int n) { return place_[n] >= zone_start; }))
      patch_from_corner(nodes, zone_start, block);
    else
      patch_by_solves(nodes, block);
  }

  std::size_t memory_bytes() const override {
    return L_->nzmax * (sizeof(double) + sizeof(int)) + 5 * L_->n * sizeof(int);
  }

 private:
  const int* column_start() const { return static_cast<const int*>(L_->p); }
  const int* column_size() const { return static_cast<const int*>(L_->nz); }
  const int* row_index() const { return static_cast<const int*>(L_->i); }
  const double* values() const { return static_cast<const double*>(L_->x); }
  double D(int j) const { return values()[column_start()[j]]; }
  int parent(int j) const { return column_size()[j] > 1 ? row_index()[column_start()[j] + 1] : -1; }

  void release() {
    cholmod_free_dense(&b_, &common_);
    cholmod_free_dense(&x_, &common_);
    cholmod_free_dense(&y_, &common_);
    cholmod_free_dense(&e_, &common_);
    cholmod_free_factor(&L_, &common_);
    cholmod_finish(&common_);
  }

  void patch_from_corner(std::span<const int> nodes, int zone_start, Eigen::Ref<MatX> block) {
    if (!corner_is_current_) {
      const int first = 3 * zone_start;
      corner_.setZero(3 * zone_size_, 3 * zone_size_);
      for (int j = 0; j < 3 * zone_size_; ++j) {
        const int start = column_start()[first + j];
        const double root = std::sqrt(values()[start]);
        corner_(j, j) = root;
        for (int k = start + 1; k < start + column_size()[first + j]; ++k)
          corner_(row_index()[k] - first, j) = root * values()[k];
      }
      corner_is_current_ = true;
    }
    places_.clear();
    for (const int n : nodes) places_.push_back(place_[n] - zone_start);
    patch_inverse_(corner_, places_, block);
  }

  // All columns of X at once, on the union of their paths to the root.
  void patch_by_solves(std::span<const int> nodes, Eigen::Ref<MatX> block) {
    compact_.assign(L_->n, -1);
    std::vector<int> path;
    for (const int n : nodes)
      for (int r = 0; r < 3; ++r)
        for (int j = 3 * place_[n] + r; j >= 0 && compact_[j] < 0; j = parent(j)) {
          compact_[j] = 0;
          path.push_back(j);
        }
    std::sort(path.begin(), path.end());
    for (int k = 0; k < static_cast<int>(path.size()); ++k) compact_[path[k]] = k;
    const int columns = 3 * static_cast<int>(nodes.size());
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Rows X = Rows::Zero(static_cast<Eigen::Index>(path.size()), columns);
    for (int i = 0; i < columns; ++i) X(compact_[3 * place_[nodes[i / 3]] + i % 3], i) = 1;
    for (int k = 0; k < static_cast<int>(path.size()); ++k) {
      const int start = column_start()[path[k]];
      for (int e = start + 1; e < start + column_size()[path[k]]; ++e)
        X.row(compact_[row_index()[e]]) -= values()[e] * X.row(k);
      X.row(k) /= std::sqrt(values()[start]);
    }
    block.setZero();
    block.selfadjointView<Eigen::Lower>().rankUpdate(X.transpose());
    block.triangularView<Eigen::StrictlyUpper>() = block.transpose();
  }

  int zone_size_;
  std::vector<int> node_;   // per place
  std::vector<int> place_;  // per node
  std::vector<int> places_;
  std::vector<int> compact_;
  cholmod_common common_;
  cholmod_factor* L_ = nullptr;
  cholmod_dense* b_ = nullptr;
  cholmod_dense* x_ = nullptr;
  cholmod_dense* y_ = nullptr;
  cholmod_dense* e_ = nullptr;
  PatchInverse patch_inverse_;
  MatX corner_;
  bool corner_is_current_ = false;
};

}  // namespace

std::unique_ptr<LowRankInverse> make_updown_inverse(const SystemMatrix& A, std::span<const int> order,
                                                    std::span<const int> zone) {
  return std::make_unique<UpdownInverse>(A, order, zone);
}

}  // namespace hapticd
