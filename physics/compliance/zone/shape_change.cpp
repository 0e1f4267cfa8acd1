#include "physics/compliance/zone/shape_change.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "physics/tissue/tetrahedron.h"

namespace hapticd {

namespace {

constexpr double negligible = 1e-14;  // of the largest diagonal of Σ a_new + Σ a_old: below it is round-off

// M = V₊V₊ᵀ − V₋V₋ᵀ by elimination with complete pivoting: a diagonal entry, or where an entry beside the
// diagonal is much larger, the 2 × 2 block around it by its eigenvectors. M is used up.
void split_by_sign(MatX& M, double least, ShapeChange& out) {
  const double alpha = (1 + std::sqrt(17.0)) / 8;
  const Eigen::Index n = M.rows();
  out.added.resize(n, n);
  out.taken_out.resize(n, n);
  Eigen::Index plus = 0, minus = 0;
  VecX v(n);
  const auto eliminate = [&](double pivot) {  // M ← M − v vᵀ / pivot
    v /= std::sqrt(std::abs(pivot));
    M.noalias() -= (pivot > 0 ? v : VecX(-v)) * v.transpose();
    (pivot > 0 ? out.added.col(plus++) : out.taken_out.col(minus++)) = v;
  };
  const auto clear = [&](Eigen::Index i) {
    M.row(i).setZero();
    M.col(i).setZero();
  };
  while (plus + minus < n) {
    Eigen::Index d = 0, p = 0, q = 0;
    const double diagonal = M.diagonal().cwiseAbs().maxCoeff(&d);
    const double entry = M.cwiseAbs().maxCoeff(&p, &q);
    if (!(entry > least)) break;
    if (diagonal >= alpha * entry) {
      v = M.col(d);
      eliminate(M(d, d));
      clear(d);
      continue;
    }
    Eigen::Matrix2d block;
    block << M(p, p), M(p, q), M(q, p), M(q, q);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen(block);
    MatX columns(n, 2);
    columns << M.col(p), M.col(q);
    for (int k = 0; k < 2; ++k) {
      v = columns * eigen.eigenvectors().col(k);
      eliminate(eigen.eigenvalues()[k]);
    }
    clear(p);
    clear(q);
  }
  out.added.conservativeResize(n, plus);
  out.taken_out.conservativeResize(n, minus);
}

}  // namespace

ShapeChange shape_change(const SystemMatrix& law, std::span<const std::uint8_t> fixed,
                         std::span<const SignedElement> elements) {
  ShapeChange out;
  for (const SignedElement& e : elements)
    out.nodes.insert(out.nodes.end(), e.form.node.begin(), e.form.node.end());
  std::sort(out.nodes.begin(), out.nodes.end());
  out.nodes.erase(std::unique(out.nodes.begin(), out.nodes.end()), out.nodes.end());
  const auto row = [&](int n) {
    return 3 * (std::lower_bound(out.nodes.begin(), out.nodes.end(), n) - out.nodes.begin());
  };
  const auto size = static_cast<Eigen::Index>(3 * out.nodes.size());
  MatX M = MatX::Zero(size, size);
  VecX summed = VecX::Zero(size);
  for (const SignedElement& e : elements) {
    const Gradients b = e.rotation * e.form.gradients;
    const double mass = law.lumped_mass(e.form.volume);
    for (int i = 0; i < 4; ++i) {
      if (fixed[e.form.node[i]]) continue;
      const Eigen::Index at = row(e.form.node[i]);
      for (int j = 0; j < 4; ++j) {
        if (fixed[e.form.node[j]]) continue;
        Mat3 K = stiffness_block(b.col(i), b.col(j), e.form.volume, law.mu(), law.lambda());
        if (i == j) {
          K.diagonal().array() += mass;
          summed.segment<3>(at) += K.diagonal();
        }
        M.block<3, 3>(at, row(e.form.node[j])) += e.sign * K;
      }
    }
  }
  if (size > 0) split_by_sign(M, negligible * summed.maxCoeff(), out);
  return out;
}

}  // namespace hapticd
