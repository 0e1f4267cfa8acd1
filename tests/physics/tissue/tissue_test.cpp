#include "physics/tissue/tissue.h"

#include <gtest/gtest.h>

#include <Eigen/SparseCholesky>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "physics/compliance/system_matrix.h"
#include "physics/tissue/tetrahedron.h"
#include "tests/physics/tissue/random_shapes.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

const Vec3 size(9e-3, 8e-3, 6e-3);
const Material soft{3000, 0.45, 1000, 0, 0};

TissueModel box_model(int cells, std::span<const int> fixed = {}, int split = 6) {
  TetMesh mesh = box_mesh(size, cells, cells, cells, split);
  jitter_interior(mesh, size, 0.25 * size.z() / cells, 7);
  return make_tissue_model(std::move(mesh), soft, fixed, Vec3(0, 0, -9.81));
}

VecX internal(const TissueModel& model, const TissueState& state) {
  VecX f(3 * model.node_count());
  internal_forces(model, state, f);
  return f;
}

// N/m of a spring as stiff as the body, times its size: the force that round-off is judged against.
double force_scale() { return soft.young * size.x() * size.x(); }

TEST(Tissue, RigidMotionGivesNoForceAndNoEnergy) {
  const TissueModel model = box_model(4);
  std::mt19937 random(1);
  TissueState state = rest_state(model);
  for (int i = 0; i < 20; ++i) {
    const Mat3 R = random_rotation(random);
    const Vec3 shift = random_vector(random, 0.05);
    for (int n = 0; n < model.node_count(); ++n) state.x[n] = R * model.mesh.nodes[n] + shift;
    update_rotations(model, state);
    EXPECT_LT(internal(model, state).norm(), 1e-10 * force_scale());
    EXPECT_LT(elastic_energy(model, state), 1e-20 * force_scale() * size.x());
  }
}

TEST(Tissue, ForceIsTheNegativeGradientOfTheEnergy) {
  const TissueModel model = box_model(2);
  std::mt19937 random(2);
  TissueState state = rest_state(model);
  for (Vec3& x : state.x) x = 1.1 * x + random_vector(random, 3e-4);
  update_rotations(model, state);
  const VecX f = internal(model, state);
  double worst = 0;
  for (int k = 0; k < f.size(); ++k) {
    const double step = 1e-8;
    TissueState moved = state;
    moved.x[k / 3][k % 3] += step;
    update_rotations(model, moved);
    const double forward = elastic_energy(model, moved);
    moved.x[k / 3][k % 3] -= 2 * step;
    update_rotations(model, moved);
    worst = std::max(worst, std::abs((forward - elastic_energy(model, moved)) / (2 * step) + f[k]));
  }
  EXPECT_LT(worst, 1e-6 * f.norm());
}

TEST(Tissue, InternalForcesNeitherPushNorTwistAFreeBody) {
  const TissueModel model = box_model(3);
  std::mt19937 random(3);
  TissueState state = rest_state(model);
  for (Vec3& x : state.x) x += random_vector(random, 4e-4);
  update_rotations(model, state);
  const VecX f = internal(model, state);
  Vec3 force = Vec3::Zero();
  Vec3 torque = Vec3::Zero();
  for (int n = 0; n < model.node_count(); ++n) {
    force += f.segment<3>(3 * n);
    torque += state.x[n].cross(f.segment<3>(3 * n));
  }
  EXPECT_LT(force.norm(), 1e-13 * f.norm());
  EXPECT_LT(torque.norm(), 1e-12 * f.norm() * size.x());
}

// An affine displacement on the boundary of an irregular mesh makes the same affine field inside.
TEST(Tissue, PatchTest) {
  for (const int split : {5, 6}) {
    const TissueModel model = box_model(4, {}, split);
    std::mt19937 random(4);
    const Mat3 G = random_matrix(random, 0.05);
    std::vector<int> boundary;
    for (int n = 0; n < model.node_count(); ++n)
      if (on_box_boundary(model.mesh.nodes[n], size)) boundary.push_back(n);
    const int inside = model.node_count() - static_cast<int>(boundary.size());
    ASSERT_EQ(inside, 27);

    // Linear small strain: K_ii u_i = −K_ib u_b, with K from a step so long that mass counts for nothing.
    const TissueState state = rest_state(model);
    const MatX K = MatX(assemble_system_matrix(model, state, 1e9));
    std::vector<int> index;
    for (int n = 0; n < model.node_count(); ++n)
      if (!on_box_boundary(model.mesh.nodes[n], size))
        for (int r = 0; r < 3; ++r) index.push_back(3 * n + r);
    VecX u = VecX::Zero(K.rows());
    for (const int n : boundary) u.segment<3>(3 * n) = G * model.mesh.nodes[n];
    const VecX solved = K(index, index).llt().solve(-(K * u)(index));
    double error = 0;
    double scale = 0;
    for (int k = 0; k < solved.size(); ++k) {
      const double exact = (G * model.mesh.nodes[index[k] / 3])[index[k] % 3];
      error = std::max(error, std::abs(solved[k] - exact));
      scale = std::max(scale, std::abs(exact));
    }
    EXPECT_LT(error, 1e-12 * scale);

    // Co-rotational, large strain and rotation: interior nodes are in equilibrium.
    TissueState large = rest_state(model);
    const Mat3 F = random_rotation(random) * (Mat3::Identity() + random_matrix(random, 0.2));
    for (int n = 0; n < model.node_count(); ++n) large.x[n] = F * model.mesh.nodes[n];
    update_rotations(model, large);
    EXPECT_LT(VecX(internal(model, large)(index)).norm(), 1e-12 * internal(model, large).norm());
  }
}

TEST(Tissue, MassAndWeightByHand) {
  const TissueModel model = box_model(3);
  const TissueState state = rest_state(model);
  const double mass = soft.density * size.prod();
  EXPECT_NEAR(std::accumulate(state.mass.begin(), state.mass.end(), 0.0), mass, 1e-12 * mass);
  VecX f(3 * model.node_count());
  external_forces(model, state, f);
  EXPECT_NEAR(f.sum(), -9.81 * mass, 1e-12 * mass);
}

TEST(Tissue, FixedNodesCarryNoForce) {
  const TetMesh mesh = box_mesh(size, 2, 2, 2);
  const TissueModel model = make_tissue_model(mesh, soft, mesh.group("bottom")->nodes, Vec3(0, 0, -9.81));
  TissueState state = rest_state(model);
  for (Vec3& x : state.x) x *= 1.2;
  update_rotations(model, state);
  VecX weight(3 * model.node_count());
  external_forces(model, state, weight);
  const VecX f = internal(model, state) + weight;
  for (const int n : mesh.group("bottom")->nodes) EXPECT_EQ(f.segment<3>(3 * n), Vec3::Zero());
  EXPECT_GT(f.norm(), 0);
}

TEST(Tissue, RemovalEqualsAModelWithoutTheElements) {
  const TissueModel model = box_model(3);
  std::mt19937 random(5);
  TissueState state = rest_state(model);
  for (Vec3& x : state.x) x += random_vector(random, 4e-4);
  for (Vec3& v : state.v) v = random_vector(random, 0.1);
  // A whole corner with its node, and some others.
  std::vector<int> gone = {40, 55, 90, 91};
  for (int t = 0; t < model.tet_count(); ++t)
    for (const int n : model.mesh.tets[t])
      if (n == 0) gone.push_back(t);
  const int count = remove_tets(model, state, gone);
  EXPECT_EQ(remove_tets(model, state, gone), 0);
  EXPECT_EQ(state.removed, count);
  EXPECT_EQ(state.live_tets_of_node[0], 0);
  EXPECT_EQ(state.mass[0], 0);
  EXPECT_EQ(state.v[0], Vec3::Zero());
  update_rotations(model, state);

  TetMesh rest;
  rest.nodes = model.mesh.nodes;
  for (int t = 0; t < model.tet_count(); ++t)
    if (state.alive[t]) rest.tets.push_back(model.mesh.tets[t]);
  ASSERT_EQ(static_cast<int>(rest.tets.size()), model.tet_count() - count);
  const TissueModel without = make_tissue_model(std::move(rest), soft, {}, Vec3(0, 0, -9.81));
  TissueState other = rest_state(without);
  other.x = state.x;
  update_rotations(without, other);
  const VecX f = internal(model, state);
  EXPECT_LT((f - internal(without, other)).norm(), 1e-13 * f.norm());
  for (int n = 0; n < model.node_count(); ++n) EXPECT_DOUBLE_EQ(state.mass[n], other.mass[n]);
}

// f = −K u for any u, K symmetric with the infinitesimal rotations in its null space.
TEST(Tissue, OfALinearModelForceIsLinearAndInfinitesimalRotationsAreFree) {
  TissueModel model = box_model(2);
  model.corotational = false;
  std::mt19937 random(9);
  TissueState state = rest_state(model), twice = state, spun = state;
  for (int n = 0; n < model.node_count(); ++n) {
    const Vec3 u = random_vector(random, 3e-3);
    state.x[n] += u;
    twice.x[n] += 2 * u;
    spun.x[n] += Vec3(1, -2, 0.5).cross(model.mesh.nodes[n]);
  }
  for (TissueState* s : {&state, &twice, &spun}) update_rotations(model, *s);
  EXPECT_LT((internal(model, twice) - 2 * internal(model, state)).norm(),
            1e-12 * internal(model, state).norm());
  EXPECT_NEAR(elastic_energy(model, twice), 4 * elastic_energy(model, state),
              1e-12 * elastic_energy(model, twice));
  EXPECT_LT(internal(model, spun).norm(), 1e-10 * force_scale());
}

TEST(Tissue, RefusesBadMeshesByName) {
  TetMesh mesh = box_mesh(size, 1, 1, 1);
  std::swap(mesh.tets[3][0], mesh.tets[3][1]);
  const auto message = [](const TetMesh& m, std::vector<int> fixed) {
    try {
      make_tissue_model(m, soft, fixed, Vec3::Zero());
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(message(mesh, {}).find("tetrahedron 3 "), std::string::npos);
  mesh = box_mesh(size, 1, 1, 1);
  mesh.tets[2][1] = 8;
  EXPECT_NE(message(mesh, {}).find("tetrahedron 2 "), std::string::npos);
  EXPECT_NE(message(box_mesh(size, 1, 1, 1), {8}).find("fixed node 8"), std::string::npos);
}

// Eight at a time as one by one, the last few and the dead ones too.
TEST(Tissue, SumsSideBySideAsOneByOne) {
  for (const bool corotational : {true, false}) {
    TissueModel model = box_model(3);
    model.corotational = corotational;
    std::mt19937 random(12);
    TissueState state = rest_state(model);
    remove_tets(model, state, std::vector<int>{0, 5, 6, 7, 40, 161});
    ASSERT_NE((model.tet_count() - state.removed) % 8, 0);
    for (Vec3& x : state.x) x = 1.1 * x + random_vector(random, 3e-4);
    update_rotations(model, state);
    VecX expected = VecX::Zero(3 * model.node_count());
    double least = 1, least_moved = 1;
    VecX dx = 1e-4 * VecX::Random(expected.size());
    for (int t = 0; t < model.tet_count(); ++t) {
      if (!state.alive[t]) continue;
      Corners x = corners_of(model.mesh.tets[t], state.x);
      Mat3 F = deformation_gradient(x, model.gradients[t]);
      if (!corotational) F = 0.5 * (F + F.transpose()).eval();
      const Corners f =
          element_forces(F, state.rotation[t], model.gradients[t], model.volume[t], soft.mu(), soft.lambda());
      for (int a = 0; a < 4; ++a) expected.segment<3>(3 * model.mesh.tets[t][a]) += f.col(a);
      least = std::min(least, signed_volume(x.col(0), x.col(1), x.col(2), x.col(3)));
      for (int a = 0; a < 4; ++a) x.col(a) += dx.segment<3>(3 * model.mesh.tets[t][a]);
      least_moved = std::min(least_moved, signed_volume(x.col(0), x.col(1), x.col(2), x.col(3)));
    }
    EXPECT_LT((internal(model, state) - expected).norm(), 1e-13 * expected.norm());
    VecX both(expected.size());
    internal_forces(model, state, dx, 0.3, both);
    subtract_stiffness(model, state, dx, 0.3, expected);
    EXPECT_LT((both - expected).norm(), 1e-13 * expected.norm());
    EXPECT_NEAR(least_volume(model, state, nullptr), least, 1e-13 * least);
    EXPECT_NEAR(least_volume(model, state, &dx), least_moved, 1e-13 * least);
  }
}

// s K dx of the law that A is made of: of A without mass, less none.
TEST(Tissue, StiffnessTimesAMotionIsTheMatrixTimesIt) {
  const TissueModel model = box_model(3);
  std::mt19937 random(13);
  TissueState state = rest_state(model);
  for (Vec3& x : state.x) x = 1.1 * x + random_vector(random, 3e-4);
  update_rotations(model, state);
  remove_tets(model, state, std::vector<int>{3, 4, 77});
  const double h = 0.02;
  const VecX x = VecX::Random(3 * model.node_count());
  const VecX expected = assemble_system_matrix(model, state, h) * x;
  EXPECT_LT((multiply_system_matrix(model, state, h, x) - expected).norm(), 1e-12 * expected.norm());
}

TEST(Tissue, TheLeastVolumeByHand) {
  TetMesh mesh;
  mesh.nodes = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  mesh.tets = {{0, 1, 2, 3}};
  const TissueModel model = make_tissue_model(mesh, soft, {}, Vec3::Zero());
  TissueState state = rest_state(model);
  EXPECT_DOUBLE_EQ(least_volume(model, state, nullptr), 1.0 / 6);
  VecX dx = VecX::Zero(12);
  dx[11] = -2;  // the top corner through the floor
  EXPECT_DOUBLE_EQ(least_volume(model, state, &dx), -1.0 / 6);
  dx[11] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(least_volume(model, state, &dx)));
}

}  // namespace
}  // namespace hapticd
