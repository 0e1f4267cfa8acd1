// The paper's compliance: the reference factor is never updated, each removal leaves a term, entries are made
// on demand.
//
//   C_k(i, j) = C₀(i, j) + Σ_q s_q T_q(i, :) T_q(j, :)ᵀ                                 (the paper's eqs. 6,
//   7) T_q = U W Λ^(−1/2),   U = C_q Gₑ V,   I ∓ Vᵀ Gₑᵀ C_q Gₑ V = W Λ Wᵀ                   (its eqs. 4, 5)
//
// T_q is the paper's L_q Λ_q^(−1/2). Departures: with a_e = V Vᵀ the small matrix is I − VᵀCV instead of
// Q = S⁻¹ + GᵀCG, so no inverse of a_e is needed and a vanishing Λ shows that the element held the rest.
// C₀ stays a factor, and rows of C₀ and of T exist only for nodes that were asked for: the zone, corners of
// removed elements, patches. A whole vector then costs two solves with the reference factor, because A₀ y = b
// + Σ a_e y needs y only at removed elements' corners. Cost of the k-th removal and of a patch: proportional
// to k. Memory: 12 numbers per row and removal.
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <stdexcept>

#include "physics/compliance/factor/multifrontal_factor.h"
#include "physics/compliance/patch_inverse.h"
#include "physics/compliance/reference/low_rank_inverse.h"

namespace hapticd {

namespace {

class LazyInverse final : public LowRankInverse {
 public:
  LazyInverse(const SystemMatrix& A, std::span<const int> order, std::span<const int> zone)
      : slot_(A.node_count(), -1) {
    reference_.set_order(A, order, {}, static_cast<int>(zone.size()));
    reference_.factor(A);
    if (zone.empty()) return;
    // The zone's rows come together and at no cost from the factor's corner.
    MatX corner;
    reference_.trailing_corner(static_cast<int>(zone.size()), corner);
    std::vector<int> places;
    for (const int n : zone) {
      slot_[n] = static_cast<int>(nodes_.size());
      nodes_.push_back(n);
      places.push_back(reference_.place(n) - (A.node_count() - static_cast<int>(zone.size())));
    }
    reserve_rows();
    PatchInverse()(corner, places, C0_.topLeftCorner(rows(), rows()));
  }

  bool change(const ElementTerm& term, TermSign sign) override {
    demand({term.node.data(), static_cast<std::size_t>(term.corners)});
    const double s = sign == TermSign::add ? -1 : 1;
    const int k = columns_;
    MatX TV = MatX::Zero(k, term.rank);  // diag(s) T(e, :)ᵀ V
    MatX U = MatX::Zero(rows(), term.rank);
    for (int c = 0; c < term.corners; ++c) {
      const auto V = term.V.block(3 * c, 0, 3, term.rank);
      const int row = 3 * slot_[term.node[c]];
      TV.noalias() += T_.block(row, 0, 3, k).transpose() * V;
      U.noalias() += C0_.block(0, row, rows(), 3) * V;
    }
    TV.array().colwise() *= sign_.head(k).array();
    U.noalias() += T_.topLeftCorner(rows(), k) * TV;

    MatX N = MatX::Identity(term.rank, term.rank);
    for (int c = 0; c < term.corners; ++c)
      N -= s * term.V.block(3 * c, 0, 3, term.rank).transpose() * U.middleRows(3 * slot_[term.node[c]], 3);
    if (!N.allFinite()) return false;
    const Eigen::SelfAdjointEigenSolver<MatX> eigen(N);
    if (eigen.info() != Eigen::Success || !(eigen.eigenvalues().minCoeff() > 0)) return false;

    Term kept{term, s, k, eigen.eigenvectors() * eigen.eigenvalues().cwiseSqrt().cwiseInverse().asDiagonal()};
    reserve_columns(k + term.rank);
    T_.block(0, k, rows(), term.rank).noalias() = U * kept.scaled_vectors;
    sign_.segment(k, term.rank).setConstant(s);
    columns_ += term.rank;
    terms_.push_back(std::move(kept));
    return true;
  }

  int place(int node) const override { return reference_.place(node); }

  void apply(VecX& x) override {
    const VecX b = x;
    solve_reference(x);
    if (terms_.empty()) return;
    MatX g(rows(), 1);
    for (std::size_t n = 0; n < nodes_.size(); ++n) g.block<3, 1>(3 * n, 0) = x.segment<3>(3 * nodes_[n]);
    sweep(g, nullptr);
    x = b;
    for (const Term& term : terms_) {
      Eigen::Matrix<double, 12, 1> Vy = Eigen::Matrix<double, 12, 1>::Zero();
      const auto V = [&](int c) { return term.element.V.block<3, 12>(3 * c, 0); };
      for (int c = 0; c < term.element.corners; ++c)
        Vy += V(c).transpose() * g.block<3, 1>(3 * slot_[term.element.node[c]], 0);
      for (int c = 0; c < term.element.corners; ++c)
        x.segment<3>(3 * term.element.node[c]) += term.sign * (V(c) * Vy);
    }
    solve_reference(x);
  }

  void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) override {
    demand(nodes);
    const int count = static_cast<int>(nodes.size());
    std::vector<int> index(3 * nodes.size());
    for (int i = 0; i < 3 * count; ++i) index[i] = 3 * slot_[nodes[i / 3]] + i % 3;
    block = C0_(index, index);
    // Runs of equal sign, in panels that stay in the cache.
    constexpr int panel = 192;
    MatX rows_of_patch(3 * count, panel);
    for (int k = 0; k < columns_;) {
      int end = k + 1;
      while (end < columns_ && end < k + panel && sign_[end] == sign_[k]) ++end;
      auto part = rows_of_patch.leftCols(end - k);
      part = T_(index, Eigen::seqN(k, end - k));
      block.selfadjointView<Eigen::Lower>().rankUpdate(part, sign_[k]);
      k = end;
    }
    block.triangularView<Eigen::StrictlyUpper>() = block.transpose();
  }

  std::size_t memory_bytes() const override {
    return reference_.memory_bytes() + terms_.size() * sizeof(Term) +
           static_cast<std::size_t>(C0_.size() + T_.size()) * sizeof(double);
  }

 private:
  struct Term {
    ElementTerm element;
    double sign;          // of T Tᵀ: + for an element taken out
    int first_column;     // in T
    MatX scaled_vectors;  // W Λ^(−1/2)
  };

  Eigen::Index rows() const { return 3 * static_cast<Eigen::Index>(nodes_.size()); }

  void reserve_rows() {
    if (C0_.rows() >= rows()) return;
    const Eigen::Index more = std::max<Eigen::Index>(rows(), C0_.rows() * 3 / 2);
    C0_.conservativeResize(more, more);
    T_.conservativeResize(more, T_.cols());
  }

  void reserve_columns(int columns) {
    if (T_.cols() >= columns) return;
    const Eigen::Index more = std::max<Eigen::Index>(columns + 240, T_.cols() * 3 / 2);
    T_.conservativeResize(C0_.rows(), more);
    sign_.conservativeResize(more);
  }

  void solve_reference(VecX& x) {
    Eigen::Map<VecX> y = reference_.vector();
    for (int n = 0; n < static_cast<int>(slot_.size()); ++n)
      y.segment<3>(3 * reference_.place(n)) = x.segment<3>(3 * n);
    reference_.solve();
    for (int n = 0; n < static_cast<int>(slot_.size()); ++n)
      x.segment<3>(3 * n) = y.segment<3>(3 * reference_.place(n));
  }

  // Rows of C₀ and of T for nodes not met before.
  void demand(std::span<const int> nodes) {
    const int before = static_cast<int>(nodes_.size());
    for (const int n : nodes) {
      if (slot_[n] >= 0) continue;
      slot_[n] = static_cast<int>(nodes_.size());
      nodes_.push_back(n);
    }
    const int fresh = static_cast<int>(nodes_.size()) - before;
    if (fresh == 0) return;
    reserve_rows();
    VecX x(3 * slot_.size());
    for (int s = before; s < before + fresh; ++s)
      for (int r = 0; r < 3; ++r) {
        x.setZero();
        x[3 * nodes_[s] + r] = 1;
        solve_reference(x);
        for (int i = 0; i < before + fresh; ++i) {
          C0_.block<3, 1>(3 * i, 3 * s + r) = x.segment<3>(3 * nodes_[i]);
          C0_.block<1, 3>(3 * s + r, 3 * i) = x.segment<3>(3 * nodes_[i]).transpose();
        }
      }
    if (terms_.empty()) return;
    MatX g = C0_.block(0, 3 * before, 3 * before, 3 * fresh);
    MatX T_new(3 * fresh, columns_);
    sweep(g, &T_new);
    T_.block(3 * before, 0, 3 * fresh, columns_) = T_new;
  }

  // From columns of C₀ (rows of g that are in use) to columns of C_k; `t` receives T_qᵀ of the right-hand
  // side.
  void sweep(MatX& g, MatX* t) const {
    for (const Term& term : terms_) {
      const int rank = term.element.rank;
      MatX Vg = MatX::Zero(rank, g.cols());
      for (int c = 0; c < term.element.corners; ++c)
        Vg += term.element.V.block(3 * c, 0, 3, rank).transpose() *
              g.middleRows(3 * slot_[term.element.node[c]], 3);
      const MatX amplitude = term.scaled_vectors.transpose() * Vg;
      if (t) t->middleCols(term.first_column, rank) = amplitude.transpose();
      g.noalias() += T_.block(0, term.first_column, g.rows(), rank) * (term.sign * amplitude);
    }
  }

  MultifrontalFactor reference_;
  std::vector<int> slot_;   // per node: its place among those asked for, or −1
  std::vector<int> nodes_;  // per slot
  std::vector<Term> terms_;
  MatX C0_;  // of the slots, and room to grow
  MatX T_;
  VecX sign_;  // per column of T
  int columns_ = 0;
};

}  // namespace

std::unique_ptr<LowRankInverse> make_lazy_inverse(const SystemMatrix& A, std::span<const int> order,
                                                  std::span<const int> zone) {
  return std::make_unique<LazyInverse>(A, order, zone);
}

}  // namespace hapticd
