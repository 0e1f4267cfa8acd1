#include "physics/compliance/element_term.h"

#include <algorithm>
#include <cmath>

#include "physics/tissue/tetrahedron.h"

namespace hapticd {

namespace {

using Mat12 = Eigen::Matrix<double, 12, 12>;

// Column by column, skipping those whose pivot is below `smallest`. Returns how many were kept.
int semidefinite_cholesky(Mat12& a, Mat12& V, double smallest) noexcept {
  int rank = 0;
  for (int k = 0; k < 12; ++k) {
    if (!(a(k, k) > smallest)) continue;
    const double pivot = std::sqrt(a(k, k));
    V.col(rank).setZero();
    for (int i = k; i < 12; ++i) V(i, rank) = a(i, k) / pivot;
    for (int j = k; j < 12; ++j)
      for (int i = j; i < 12; ++i) a(i, j) -= V(i, rank) * V(j, rank);
    ++rank;
  }
  return rank;
}

}  // namespace

ElementTerm element_term(const TissueModel& model, double h, int tet, double left, const Mat3& rotation,
                         const Tet& corners) noexcept {
  const Material& material = model.material;
  const Elasticity& law = model.elastic[tet];
  const double stiffness = model.dynamic ? 1 + material.rayleigh_stiffness / h : 1;
  const double volume = left * model.volume[tet];
  const double mass =
      model.dynamic ? (1 / (h * h) + material.rayleigh_mass / h) * 0.25 * law.density * volume : 0;
  const Gradients rotated = rotation * model.gradients[tet];
  const Tet& nodes = model.mesh.tets[tet];
  Gradients b;
  for (int c = 0; c < 4; ++c) {
    const auto at = std::find(nodes.begin(), nodes.end(), corners[c]) - nodes.begin();
    b.col(c) = rotated.col(at);
  }

  Mat12 a = Mat12::Zero();
  for (int i = 0; i < 4; ++i) {
    if (model.fixed[corners[i]]) continue;
    for (int j = 0; j <= i; ++j) {
      if (model.fixed[corners[j]]) continue;
      a.block<3, 3>(3 * i, 3 * j) =
          stiffness_block(b.col(i), b.col(j), volume, stiffness * law.mu, stiffness * law.lambda);
    }
    a.diagonal().segment<3>(3 * i).array() += mass;
  }
  ElementTerm term;
  std::copy(corners.begin(), corners.end(), term.node.begin());
  term.corners = 4;
  // Mass keeps every pivot above zero, however little it is; without it rigid modes leave round-off only.
  const double lost = (mass > 0 ? 4e-16 : 1e-13) * a.diagonal().maxCoeff();
  term.rank = semidefinite_cholesky(a, term.V, lost);
  return term;
}

ElementTerm identity_term(int node, double scale) noexcept {
  ElementTerm term;
  term.node[0] = node;
  term.corners = 1;
  term.rank = 3;
  term.V.topLeftCorner<3, 3>() = std::sqrt(scale) * Mat3::Identity();
  return term;
}

}  // namespace hapticd
