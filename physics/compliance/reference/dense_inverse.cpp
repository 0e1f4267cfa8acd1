// A dense inverse and its full Woodbury update: the oracle for small bodies, and what the paper sets out
// from.
//
//   C ← C ± U N⁻¹ Uᵀ,   U = C V,   N = I ∓ Vᵀ U
//
// Only the lower triangle of C is kept current. Cost of a change: 12 (3·nodes)² multiplications.
#include <Eigen/Cholesky>
#include <stdexcept>
#include <string>

#include "physics/compliance/reference/low_rank_inverse.h"

namespace hapticd {

namespace {

constexpr int most_nodes = 3000;

class DenseInverse final : public LowRankInverse {
 public:
  explicit DenseInverse(const SystemMatrix& A) {
    const int nodes = A.node_count();
    if (nodes > most_nodes)
      throw std::invalid_argument("a dense inverse of " + std::to_string(nodes) +
                                  " nodes is refused: " + std::to_string(most_nodes) + " are the most");
    MatX dense = MatX::Zero(3 * nodes, 3 * nodes);
    for (int n = 0; n < nodes; ++n) dense.block<3, 3>(3 * n, 3 * n) = A.diagonal()[n];
    for (std::size_t e = 0; e < A.edges().size(); ++e)
      dense.block<3, 3>(3 * A.edges()[e].j, 3 * A.edges()[e].i) = A.coupling()[e].transpose();
    const Eigen::LLT<Eigen::Ref<MatX>> factor(dense);
    if (factor.info() != Eigen::Success)
      throw std::runtime_error(
          "the system matrix A is not positive definite: a body (or a part cut from it) "
          "has neither mass nor support");
    C_ = MatX::Identity(3 * nodes, 3 * nodes);
    factor.matrixL().solveInPlace(C_);
    factor.matrixU().solveInPlace(C_);
  }

  bool change(const ElementTerm& term, TermSign sign) override {
    const double s = sign == TermSign::add ? -1 : 1;
    MatX U = MatX::Zero(C_.rows(), term.rank);
    for (int c = 0; c < term.corners; ++c)
      for (int r = 0; r < 3; ++r) {
        const Eigen::Index d = 3 * term.node[c] + r;
        const auto v = term.V.row(3 * c + r).head(term.rank);
        U.topRows(d) += C_.row(d).head(d).transpose() * v;
        U.bottomRows(U.rows() - d) += C_.col(d).tail(U.rows() - d) * v;
      }
    MatX N = MatX::Identity(term.rank, term.rank);
    for (int c = 0; c < term.corners; ++c)
      N -= s * term.V.block(3 * c, 0, 3, term.rank).transpose() * U.middleRows(3 * term.node[c], 3);
    const Eigen::LLT<MatX> factor(N);
    if (!N.allFinite() || factor.info() != Eigen::Success) return false;
    factor.matrixU().solveInPlace<Eigen::OnTheRight>(U);
    C_.selfadjointView<Eigen::Lower>().rankUpdate(U, s);
    return true;
  }

  int place(int node) const override { return node; }

  void apply(VecX& x) override { x = C_.selfadjointView<Eigen::Lower>() * x; }

  void patch(std::span<const int> nodes, Eigen::Ref<MatX> block) override {
    for (int i = 0; i < static_cast<int>(nodes.size()); ++i)
      for (int j = 0; j < static_cast<int>(nodes.size()); ++j)
        for (int r = 0; r < 3; ++r)
          for (int c = 0; c < 3; ++c) {
            const int a = 3 * nodes[i] + r;
            const int b = 3 * nodes[j] + c;
            block(3 * i + r, 3 * j + c) = C_(std::max(a, b), std::min(a, b));
          }
  }

  std::size_t memory_bytes() const override { return static_cast<std::size_t>(C_.size()) * sizeof(double); }

 private:
  MatX C_;
};

}  // namespace

std::unique_ptr<LowRankInverse> make_dense_inverse(const SystemMatrix& A) {
  return std::make_unique<DenseInverse>(A);
}

}  // namespace hapticd
