// Bodies linearised where they are about to be: one Newton step of the next time step, and nothing at rest.
#include "physics/simulation/step/predicted_linearisation.h"

#include <gtest/gtest.h>

#include <memory>

#include "physics/simulation/world.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double h = 0.02;

BodySettings soft_block(int n) {
  BodySettings b{"block", true, box_mesh(Vec3(0.02, 0.02, 0.02), n, n, n), {5000, 0.4, 1000, 5, 0.002}, {},
                 0,       true};
  b.fixed_nodes = b.mesh.group("bottom")->nodes;
  return b;
}

// Sheared by a fifth and thrown sideways.
void disturb(Body& body) {
  for (int n = 0; n < body.model.node_count(); ++n) {
    if (body.model.fixed[n]) continue;
    body.state.x[n].x() += 0.2 * body.state.x[n].z();
    body.state.v[n] = Vec3(0, 10 * body.state.x[n].z(), 0);
  }
  update_rotations(body.model, body.state);
}

TEST(PredictedLinearisation, OfWhatStaysIsTheFreeMotionOfAFreshFactor) {
  Body body(soft_block(3), h, Vec3(0, 0, -9.81)), other(soft_block(3), h, Vec3(0, 0, -9.81));
  disturb(body);
  disturb(other);
  body.free.dx.setZero();
  linearise_ahead(body, h);
  other.compliance->update(other.state);
  compute_free_motion(other, h);
  EXPECT_LT((body.free.dx - other.free.dx).norm(), 1e-9 * other.free.dx.norm());
  EXPECT_EQ(body.state.x, other.state.x);
}

// Halve the motion, and what is foreseen errs by a quarter: of a linear law by nothing.
TEST(PredictedLinearisation, WhatIsForeseenErrsByTheSquareOfTheMotion) {
  const auto error_of = [](double amplitude) {
    Body body(soft_block(3), h, Vec3::Zero()), other(soft_block(3), h, Vec3::Zero());
    VecX f = VecX::Zero(3 * body.model.node_count());
    for (Body* b : {&body, &other}) {
      for (int n = 0; n < b->model.node_count(); ++n) {
        if (b->model.fixed[n]) continue;
        const double z = b->state.x[n].z();
        b->state.x[n] += amplitude * Vec3(0.2 * z, 0, 0.1 * z);
        b->state.v[n] = amplitude * Vec3(0, 10 * z, 0);
        f.segment<3>(3 * n) = amplitude * Vec3(0, 1e-3, -2e-3);
      }
      update_rotations(b->model, b->state);
      b->compliance->update(b->state);
      compute_free_motion(*b, h);
      correct(*b, &f, h);
    }
    foresee_free_motion(body, h);
    fresh_free_motion(other, h);
    EXPECT_LT((body.free.dx - other.free.dx).norm(), 0.05 * other.free.dx.norm());
    return (body.free.dx - other.free.dx).norm();
  };
  EXPECT_NEAR(error_of(0.02) / error_of(0.01), 4, 0.2);
}

// M (Δx/h − v)/h + B Δx/h = f_ext + f_int(x + Δx) is where it no longer changes, whatever A was.
TEST(PredictedLinearisation, RepeatedItIsNewtonsMethodForTheNonlinearStep) {
  Body body(soft_block(3), h, Vec3(0, 0, -9.81));
  disturb(body);
  body.free.dx.setZero();
  double change = 1;
  for (int k = 0; k < 25; ++k) {
    const VecX before = body.free.dx;
    linearise_ahead(body, h);
    change = (body.free.dx - before).norm() / body.free.dx.norm();
  }
  EXPECT_LT(change, 1e-9);
  const VecX dx = body.free.dx;

  VecX residual(dx.size());
  Body at_end(soft_block(3), h, Vec3(0, 0, -9.81));
  disturb(at_end);
  const std::vector<Vec3> v = at_end.state.v;
  for (int n = 0; n < at_end.model.node_count(); ++n) at_end.state.x[n] += dx.segment<3>(3 * n);
  update_rotations(at_end.model, at_end.state);
  internal_forces(at_end.model, at_end.state, residual);
  const VecX elastic = residual;
  // Viscous forces of K at the end: f_int's change over a small part of the motion, rotations held.
  constexpr double part = 1e-6;
  TissueState nudged = at_end.state;
  for (int n = 0; n < at_end.model.node_count(); ++n) nudged.x[n] -= part * dx.segment<3>(3 * n);
  update_rotations(at_end.model, nudged);
  VecX back(dx.size());
  internal_forces(at_end.model, nudged, back);
  const Material& m = at_end.model.material;
  double worst = 0, largest = 0;
  for (int n = 0; n < at_end.model.node_count(); ++n) {
    if (at_end.model.fixed[n]) continue;
    const Vec3 d = dx.segment<3>(3 * n);
    const double mass = at_end.state.mass[n];
    const Vec3 inertia = mass * (d / h - v[n]) / h + m.rayleigh_mass / h * mass * d;
    const Vec3 sum = elastic.segment<3>(3 * n) + mass * Vec3(0, 0, -9.81) - inertia;
    // β K Δx/h with K's own law; the true tangent differs from it by strain times stress, here a few percent.
    const Vec3 viscous = m.rayleigh_stiffness / h * (back - elastic).segment<3>(3 * n) / part;
    worst = std::max(worst, (sum - viscous).norm());
    largest = std::max(largest, viscous.norm() + inertia.norm());
  }
  EXPECT_LT(worst, 0.03 * largest);
}

WorldSettings settings(double lead) {
  WorldSettings s;
  s.h = h;
  s.alarm_distance = 3e-3;
  s.sample_spacing = 1e-3;
  s.coupling[0] = {500, 0.05, 0};
  s.removal[0] = {50, 5e-4, 1e-3, 50};
  s.lead = lead;
  return s;
}

Instrument sphere_tip(double radius) {
  Instrument i;
  Primitive tip;
  tip.shape = Shape::sphere;
  tip.radius = radius;
  i.primitives = {tip};
  return i;
}

Vec3 settled(World& world, int steps, CondensedProblem& problem) {
  StepReport report;
  for (int i = 0; i < steps; ++i)
    report = world.step(
        [] {
          return InstrumentSample{{Vec3(0.01, 0.01, 0.0215), Quat::Identity()}, true};
        },
        problem);
  return report.contact.wrench[0].head<3>();
}

class Lead : public testing::TestWithParam<ComplianceMethod> {};

TEST_P(Lead, ChangesNothingAtRestNorAfterARemoval) {
  auto problem = std::make_unique<CondensedProblem>();
  WorldSettings ahead = settings(0.9 * h), plain = settings(0);
  ahead.compliance = plain.compliance = GetParam();
  World a({soft_block(6)}, sphere_tip(3e-3), ahead), b({soft_block(6)}, sphere_tip(3e-3), plain);
  const Vec3 fa = settled(a, 60, *problem), fb = settled(b, 60, *problem);
  EXPECT_GT(fb.z(), 1e-3);
  EXPECT_LT((fa - fb).norm(), 1e-4 * fb.norm());
  // One far from the tip and one beside it.
  a.schedule_removal(0, {3, 700});
  b.schedule_removal(0, {3, 700});
  const Vec3 ra = settled(a, 60, *problem), rb = settled(b, 60, *problem);
  EXPECT_EQ(a.removed(), 2);
  EXPECT_LT((ra - rb).norm(), 1e-4 * rb.norm());
}

INSTANTIATE_TEST_SUITE_P(Methods, Lead, testing::Values(ComplianceMethod::exact, ComplianceMethod::zone));

}  // namespace
}  // namespace hapticd
