// The guard: the gradient of its energy, a bound of its slope, nothing where nothing is collapsed, and back
// again.
#include "physics/tissue/volume_barrier.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "physics/compliance/system_matrix.h"
#include "physics/simulation/body.h"
#include "physics/tissue/tetrahedron.h"
#include "tests/physics/tissue/random_shapes.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

const Vec3 size(4e-3, 4e-3, 4e-3);

Material material(Law law) {
  Material m{3000, 0.45, 1000, 0, 0};
  m.law = law;
  return m;
}

TissueModel box(Law law, int cells = 2) {
  TetMesh mesh = box_mesh(size, cells, cells, cells);
  jitter_interior(mesh, size, 2e-4, 5);
  const std::vector<int> bottom = mesh.group("bottom")->nodes;
  return make_tissue_model(std::move(mesh), material(law), bottom, Vec3::Zero());
}

double smallest_determinant(const TissueModel& model, const TissueState& state) {
  double least = 1;
  for (int t = 0; t < model.tet_count(); ++t)
    least = std::min(
        least,
        deformation_gradient(corners_of(model.mesh.tets[t], state.x), model.gradients[t]).determinant());
  return least;
}

// Pressed flat, or through the floor, with every node a little off.
TissueState pressed(const TissueModel& model, double height, std::uint32_t seed) {
  std::mt19937 random(seed);
  TissueState state = rest_state(model);
  for (int n = 0; n < model.node_count(); ++n) {
    state.x[n].z() *= height;
    if (!model.fixed[n]) state.x[n] += random_vector(random, 2e-4);
  }
  update_rotations(model, state);
  return state;
}

TEST(Guard, ChangesNothingWhereNothingIsCollapsed) {
  const TissueModel plain = box(Law::corotational), guarded = box(Law::guarded);
  const TissueState a = pressed(plain, 0.95, 1), b = pressed(guarded, 0.95, 1);
  ASSERT_GT(smallest_determinant(guarded, b), barrier_from);
  EXPECT_TRUE(b.collapsed.empty());
  VecX f(3 * plain.node_count()), g(f.size());
  internal_forces(plain, a, f);
  internal_forces(guarded, b, g);
  EXPECT_EQ(f, g);
  EXPECT_EQ(elastic_energy(plain, a), elastic_energy(guarded, b));
}

TEST(Guard, ForceIsTheNegativeGradientOfTheEnergyFlatOrInverted) {
  const TissueModel model = box(Law::guarded);
  for (const double height : {0.3, 0.05, -0.2}) {
    const TissueState state = pressed(model, height, 2);
    ASSERT_FALSE(state.collapsed.empty());
    VecX f(3 * model.node_count());
    internal_forces(model, state, f);
    double worst = 0;
    for (int k = 0; k < f.size(); ++k) {
      if (model.fixed[k / 3]) continue;
      const double step = 1e-9;
      TissueState moved = state;
      moved.x[k / 3][k % 3] += step;
      update_rotations(model, moved);
      const double forward = elastic_energy(model, moved);
      moved.x[k / 3][k % 3] -= 2 * step;
      update_rotations(model, moved);
      worst = std::max(worst, std::abs((forward - elastic_energy(model, moved)) / (2 * step) + f[k]));
    }
    EXPECT_LT(worst, 1e-6 * f.norm()) << height;
  }
}

// The block bounds the second derivative of the guard's energy from above, and is itself positive
// semi-definite.
TEST(Guard, TangentBoundsTheSlopeFromAbove) {
  std::mt19937 random(3);
  TetMesh mesh;
  mesh.nodes = {{0, 0, 0}, {1e-3, 0, 0}, {0, 1e-3, 0}, {0, 0, 1e-3}};
  mesh.tets = {{0, 1, 2, 3}};
  const TissueModel model = make_tissue_model(std::move(mesh), material(Law::guarded), {}, Vec3::Zero());
  const auto forces = [&](const Corners& x) {
    TissueState state = rest_state(model);
    barrier(model, 0, deformation_gradient(x, model.gradients[0]), state);
    Eigen::Matrix<double, 12, 1> f = Eigen::Matrix<double, 12, 1>::Zero();
    for (const Collapsed& c : state.collapsed)
      for (int a = 0; a < 4; ++a) f.segment<3>(3 * a) = c.force * c.push.col(a);
    return f;
  };
  int checked = 0;
  for (int i = 0; i < 300; ++i) {
    const Corners x = random_rotation(random) * (Mat3::Identity() + random_matrix(random, 0.5)) *
                      Vec3(1, 1, 0.35 - 0.003 * i).asDiagonal() *
                      corners_of(model.mesh.tets[0], model.mesh.nodes);
    TissueState state = rest_state(model);
    barrier(model, 0, deformation_gradient(x, model.gradients[0]), state);
    if (state.collapsed.empty() ||
        deformation_gradient(x, model.gradients[0]).determinant() > barrier_from - 1e-3)
      continue;
    ++checked;
    Eigen::Matrix<double, 12, 12> K, slope;
    for (int a = 0; a < 4; ++a)
      for (int b = 0; b < 4; ++b) K.block<3, 3>(3 * a, 3 * b) = barrier_block(state.collapsed[0], a, b);
    for (int k = 0; k < 12; ++k) {
      Corners up = x, down = x;
      up(k % 3, k / 3) += 1e-9;
      down(k % 3, k / 3) -= 1e-9;
      slope.col(k) = (forces(down) - forces(up)) / 2e-9;
    }
    const auto smallest = [](const Eigen::Matrix<double, 12, 12>& A) {
      return Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 12, 12>>(0.5 * (A + A.transpose()))
          .eigenvalues()[0];
    };
    EXPECT_GT(smallest(K), -1e-12 * K.norm());
    // Inside out, ‖F‖ falls short of the bound by up to 2/√3.
    if (deformation_gradient(x, model.gradients[0]).determinant() >= 0) {
      EXPECT_GT(smallest(K - slope), -1e-5 * K.norm());
    }
  }
  EXPECT_GT(checked, 100);
}

TEST(Guard, IsInTheSystemMatrixAsInTheOracle) {
  const TissueModel model = box(Law::guarded, 3);
  const TissueState state = pressed(model, 0.1, 4);
  ASSERT_FALSE(state.collapsed.empty());
  SystemMatrix matrix(model, node_graph(model), 0.02);
  matrix.assemble(state);
  std::mt19937 random(6);
  VecX u(3 * model.node_count());
  for (int n = 0; n < model.node_count(); ++n) u.segment<3>(3 * n) = random_vector(random, 1);
  const VecX expected = assemble_system_matrix(model, state, 0.02) * u;
  EXPECT_LT((matrix.multiply(u) - expected).norm(), 1e-12 * expected.norm());
}

// A block turned inside out and let go comes back to its rest shape, with no number that is none.
TEST(Corotational, UnfoldsABlockThatWasPressedThroughItself) {
  for (const Law law : {Law::corotational}) {  // guarded, it stays tangled: README
    BodySettings settings;
    settings.mesh = box_mesh(size, 3, 3, 3);
    settings.fixed_nodes = settings.mesh.group("bottom")->nodes;
    settings.material = material(law);
    settings.material.rayleigh_stiffness = 2e-3;
    Body body(std::move(settings), 0.02, Vec3::Zero());
    for (Vec3& x : body.state.x)
      if (x.z() > 3.9e-3) x.z() = -0.5e-3;
    update_rotations(body.model, body.state);
    ASSERT_LT(smallest_determinant(body.model, body.state), 0);
    for (int step = 0; step < 300; ++step) {
      body.compliance->update(body.state);
      compute_free_motion(body, 0.02);
      correct(body, nullptr, 0.02);
      update_rotations(body.model, body.state);
    }
    double farthest = 0;
    for (int n = 0; n < body.model.node_count(); ++n)
      farthest = std::max(farthest, (body.state.x[n] - body.rest()[n]).norm());
    EXPECT_LT(farthest, 1e-6) << (law == Law::guarded ? "guarded" : "corotational");
  }
}

}  // namespace
}  // namespace hapticd
