#include <gtest/gtest.h>

#include "physics/compliance/compliance.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double steps[] = {0.005, 0.01, 0.02, 0.04};
constexpr double rest_time = 2.0;  // everything has come to rest by then [s]

// A damped box on a floor; the node in the middle of its top is pushed.
struct Box {
  Box() {
    TetMesh mesh = box_mesh({9e-3, 9e-3, 6e-3}, 4, 4, 3);
    bottom = mesh.group("bottom")->nodes;
    const Material damped{3000, 0.45, 1000, 10, 0.01};
    model = make_tissue_model(std::move(mesh), damped, bottom, Vec3::Zero());
    state = rest_state(model);
    dx.resize(3 * model.node_count());
  }

  // M v/h + f_int, in dx.
  void forces(double h) {
    update_rotations(model, state);
    internal_forces(model, state, dx);
    for (int n = 0; n < model.node_count(); ++n)
      if (!model.fixed[n]) dx.segment<3>(3 * n) += state.mass[n] / h * state.v[n];
  }

  void advance(double h) {
    for (int n = 0; n < model.node_count(); ++n) {
      state.x[n] += dx.segment<3>(3 * n);
      state.v[n] = dx.segment<3>(3 * n) / h;
    }
  }

  double depth() const { return model.mesh.nodes[top].z() - state.x[top].z(); }

  // What the floor carries: the force on those nodes of a body that is not held there.
  double floor_force() {
    update_rotations(model, state);
    const TissueModel loose = make_tissue_model(model.mesh, model.material, {}, Vec3::Zero());
    VecX f(dx.size());
    internal_forces(loose, state, f);
    double sum = 0;
    for (const int n : bottom) sum -= f[3 * n + 2];
    return sum;
  }

  static constexpr int top = 2 + 5 * (2 + 5 * 3);
  std::vector<int> bottom;
  TissueModel model;
  TissueState state;
  VecX dx;
};

TEST(StepSize, DisplacementUnderAConstantLoadDoesNotDependOnIt) {
  const double load = 6e-3;
  double first_depth = 0;
  for (const double h : steps) {
    Box box;
    const auto compliance = make_exact_compliance(box.model, h);
    for (double t = 0; t < rest_time; t += h) {
      box.forces(h);
      box.dx[3 * Box::top + 2] -= load;
      compliance->update(box.state);
      compliance->apply(box.dx, box.dx);
      box.advance(h);
    }
    if (first_depth == 0) first_depth = box.depth();
    EXPECT_GT(box.depth(), 0.2e-3);
    EXPECT_LT(box.dx.lpNorm<Eigen::Infinity>(), 1e-9 * box.depth());
    EXPECT_NEAR(box.depth(), first_depth, 1e-6 * first_depth);
    EXPECT_NEAR(box.floor_force(), load, 1e-6 * load);
  }
}

// The other way round: the multiplier that holds the node at a depth is newtons, not an impulse h·f.
TEST(StepSize, IndentationForceIsTheSameInNewtons) {
  const double depth = 1e-4;
  const std::vector<int> top = {Box::top};
  double first_force = 0;
  for (const double h : steps) {
    Box box;
    const auto compliance = make_exact_compliance(box.model, h);
    compliance->move_zone(top);
    MatX C(3, 3);
    VecX response(box.dx.size());
    double lambda = 0;
    for (double t = 0; t < rest_time; t += h) {
      box.forces(h);
      compliance->update(box.state);
      compliance->apply(box.dx, box.dx);
      compliance->patch(top, C);
      // One bilateral row along −z: the free motion misses the depth by C_zz λ.
      lambda = (depth - box.depth() + box.dx[3 * Box::top + 2]) / C(2, 2);
      response.setZero();
      response[3 * Box::top + 2] = -lambda;
      compliance->apply(response, response);
      box.dx += response;
      box.advance(h);
    }
    if (first_force == 0) first_force = lambda;
    EXPECT_NEAR(box.depth(), depth, 1e-12);
    EXPECT_GT(lambda, 1e-4);
    EXPECT_NEAR(lambda, first_force, 1e-6 * first_force);
    EXPECT_NEAR(box.floor_force(), lambda, 1e-6 * lambda);
  }
}

}  // namespace
}  // namespace hapticd
