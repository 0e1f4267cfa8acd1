// A box of tissue, and the inverse of its system matrix by dense factorisation, in any precision.
#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "physics/compliance/reference_compliance.h"
#include "physics/compliance/system_matrix.h"
#include "tests/physics/tissue/random_shapes.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd::oracle {

inline const Vec3 size(9e-3, 8e-3, 6e-3);
inline constexpr double h = 0.02;

inline TissueModel box(int cells, double mass_factor = 1, bool held = true) {
  TetMesh mesh = box_mesh(size, cells, cells, cells);
  jitter_interior(mesh, size, 0.2 * size.z() / cells, 11);
  const std::vector<int> bottom = held ? mesh.group("bottom")->nodes : std::vector<int>();
  return make_tissue_model(std::move(mesh), {3000, 0.45, 1000 * mass_factor, 2.0, 3e-3}, bottom,
                           Vec3::Zero());
}

inline TissueState deformed(const TissueModel& model, unsigned seed, double amplitude = 4e-4) {
  std::mt19937 random(seed);
  TissueState state = rest_state(model);
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n]) state.x[n] += random_vector(random, amplitude);
  update_rotations(model, state);
  return state;
}

inline bool in_system(const TissueModel& model, const TissueState& state, int node) {
  return !model.fixed[node] && state.live_tets_of_node[node] > 0;
}

// C B, with zero rows and columns of nodes outside the system. Scalar: long double where A is nearly
// singular.
template <typename Scalar = double>
MatX solve(const TissueModel& model, const TissueState& state, MatX B) {
  using Matrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;
  for (int n = 0; n < model.node_count(); ++n)
    if (!in_system(model, state, n)) B.middleRows(3 * n, 3).setZero();
  const MatX A = MatX(assemble_system_matrix(model, state, h));
  const Eigen::LLT<Matrix> factor(A.cast<Scalar>());
  return factor.solve(Matrix(B.cast<Scalar>())).template cast<double>();
}

template <typename Scalar = double>
MatX inverse(const TissueModel& model, const TissueState& state) {
  MatX C = solve<Scalar>(model, state, MatX::Identity(3 * model.node_count(), 3 * model.node_count()));
  for (int n = 0; n < model.node_count(); ++n)
    if (!in_system(model, state, n)) C.middleCols(3 * n, 3).setZero();
  return C;
}

// The free nodes nearest to a point, nearest first.
inline std::vector<int> nearest(const TissueModel& model, const Vec3& point, int count) {
  std::vector<int> nodes;
  for (int n = 0; n < model.nodes_in_use; ++n)
    if (!model.fixed[n]) nodes.push_back(n);
  std::sort(nodes.begin(), nodes.end(), [&](int a, int b) {
    return (model.mesh.nodes[a] - point).norm() < (model.mesh.nodes[b] - point).norm();
  });
  nodes.resize(std::min(nodes.size(), static_cast<std::size_t>(count)));
  return nodes;
}

// Elements whose free nodes are all in `zone`, some of them, or none.
enum class Where { inside, across, outside };
inline Where where(const TissueModel& model, const std::vector<int>& zone, int tet) {
  bool in = false;
  bool out = false;
  for (const int n : model.mesh.tets[tet]) {
    if (model.fixed[n]) continue;
    const bool here = std::find(zone.begin(), zone.end(), n) != zone.end();
    in = in || here;
    out = out || !here;
  }
  return in && !out ? Where::inside : in ? Where::across : Where::outside;
}

inline double relative(const MatX& value, const MatX& expected) {
  return expected.norm() > 0 ? (value - expected).norm() / expected.norm() : value.norm();
}

inline std::vector<int> dofs_of(const std::vector<int>& nodes) {
  std::vector<int> index;
  for (const int n : nodes)
    for (int r = 0; r < 3; ++r) index.push_back(3 * n + r);
  return index;
}

// A load of every wavelength.
inline VecX load(Eigen::Index dofs) {
  VecX b(dofs);
  for (Eigen::Index i = 0; i < b.size(); ++i) b[i] = std::cos(0.7 * static_cast<double>(i));
  return b;
}

// Relative errors of `apply` on that load, and of `patch`, against C or against what they should give.
inline double load_error(Compliance& compliance, const VecX& b, const VecX& expected) {
  VecX y(b.size());
  compliance.apply(b, y);
  return relative(y, expected);
}

inline double block_error(Compliance& compliance, const std::vector<int>& nodes, const MatX& expected) {
  MatX block(expected.rows(), expected.cols());
  compliance.patch(nodes, block);
  return relative(block, expected);
}

inline double apply_error(Compliance& compliance, const MatX& C) {
  const VecX b = load(C.rows());
  return load_error(compliance, b, C * b);
}

inline double patch_error(Compliance& compliance, const MatX& C, const std::vector<int>& nodes) {
  const std::vector<int> dofs = dofs_of(nodes);
  return block_error(compliance, nodes, C(dofs, dofs));
}

}  // namespace hapticd::oracle
