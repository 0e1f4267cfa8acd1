// An instrument that tissue presses from outside cannot come from inside: samples hold it whichever way their
// faces are turned.
#include <gtest/gtest.h>

#include "tests/support/contact_loop.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

constexpr double k = 30, r = 0.25e-3;

// Triangles with a sample at the centroid, each node on a spring k: the sample gives way by f / 3k.
struct Faces {
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();

  Faces() {
    problem->step = 1;
    problem->alarm_distance = 0.4e-3;
  }
  // About `centre`, the outward normal up or down.
  void add(const Vec3& centre, bool up) {
    CondensedProblem& p = *problem;
    const int n = p.nodes;
    const double side = up ? 0.3e-3 : -0.3e-3;
    const Vec3 corner[] = {Vec3(-side, -0.1e-3, 0), Vec3(side, -0.1e-3, 0), Vec3(0, 0.2e-3, 0)};
    for (int c = 0; c < 3; ++c) p.x_free[n + c] = p.x_now[n + c] = centre + corner[c];
    p.nodes += 3;
    p.C() = MatX::Identity(3 * p.nodes, 3 * p.nodes) / k;
    p.sample[p.samples] = {.id = std::uint64_t(p.samples + 1) << 12,
                           .node = {n, n + 1, n + 2},
                           .weight = {1. / 3, 1. / 3, 1. / 3},
                           .free = Vec3::Zero(),
                           .outward = Vec3(0, 0, up ? 1 : -1),
                           .friction = 0};
    ++p.samples;
  }
};

// Along x.
Instrument rod() {
  Instrument instrument;
  Primitive p;
  p.shape = Shape::capsule;
  p.radius = r;
  p.half_length = 2e-3;
  p.placement.q = Quat::FromTwoVectors(Vec3::UnitZ(), Vec3::UnitX());
  instrument.primitives.push_back(p);
  return instrument;
}

Pose above(double gap) { return {Vec3(0, 0, r + gap), Quat::Identity()}; }

// A rod lies across the near face of a flap and across its far face, turned away, which has folded over
// beside it and lies 10 µm lower. Pressed by d, both hold:
//   force = 3k d + 3k (d − 10 µm),   no overlap.
// By its face the far side would be let through, and near to half of the force with it.
TEST(Outside, ARodAcrossTheFarSideOfAFlapIsHeldByIt) {
  Faces flap;
  flap.add(Vec3(-0.5e-3, 0, 0), true);
  flap.add(Vec3(0.5e-3, 0, -10e-6), false);
  ContactLoop loop;
  ContactSolution solution;
  for (int tick = 0; tick <= 20; ++tick)
    solution = loop.solve(*flap.problem, rod(), above(50e-6 - 5e-6 * tick));
  EXPECT_NEAR(solution.wrench[0][2], 3 * k * 90e-6, 1e-9);
  EXPECT_LT(solution.penetration, 1e-12);
}

// The far side of a flap 20 µm thin bears nothing while the near side holds.
TEST(Outside, TheFarSideOfAThinFlapChangesNoForce) {
  Faces flap;
  flap.add(Vec3::Zero(), true);
  flap.add(Vec3(0, 0, -20e-6), false);
  for (int c = 0; c < 3; ++c)  // the two sides' nodes go together
    for (int axis = 0; axis < 3; ++axis)
      flap.problem->C()(3 * c + axis, 9 + 3 * c + axis) = flap.problem->C()(9 + 3 * c + axis, 3 * c + axis) =
          1 / k;
  std::swap(flap.problem->x_free[3], flap.problem->x_free[4]);  // above one another
  flap.problem->x_now = flap.problem->x_free;
  flap.problem->sample[1].node = {4, 3, 5};
  ContactLoop loop;
  for (int tick = 0; tick <= 30; ++tick) {
    const double d = 5e-6 * tick;
    EXPECT_NEAR(loop.solve(*flap.problem, rod(), above(-d)).wrench[0][2], 3 * k * d, 1e-9);
  }
}

// One that is inside leaves through faces that are turned away without a force, until it is past its middle.
TEST(Outside, AnInstrumentThatBeginsInsideIsLetOut) {
  Faces skin;
  skin.add(Vec3::Zero(), false);
  ContactLoop loop;
  for (double z = 0.5e-3; z > 0.02e-3; z -= 10e-6) {
    const ContactSolution solution = loop.solve(*skin.problem, rod(), {Vec3(0, 0, z), Quat::Identity()});
    EXPECT_EQ(solution.wrench[0].norm(), 0) << z;
    EXPECT_FALSE(loop.state.memory.outside[0]);
  }
}

// Lifted off it is outside as before: a face turned away that it then comes to first holds it.
TEST(Outside, StaysOutsideWhereItTouchesNothing) {
  Faces flap;
  flap.add(Vec3(-0.5e-3, 0, 0), true);
  flap.add(Vec3(0.5e-3, 0, -10e-6), false);
  ContactLoop loop;
  for (int tick = 0; tick <= 5; ++tick) loop.solve(*flap.problem, rod(), above(5e-6 - 5e-6 * tick));
  EXPECT_TRUE(loop.state.memory.outside[0]);
  for (int tick = 0; tick < 5; ++tick) loop.solve(*flap.problem, rod(), above(50e-6));
  EXPECT_TRUE(loop.state.memory.outside[0]);
  // The other one is higher now.
  for (int n = 0; n < 6; ++n) flap.problem->x_free[n].z() = n < 3 ? -10e-6 : 0;
  flap.problem->x_now = flap.problem->x_free;
  EXPECT_NEAR(loop.solve(*flap.problem, rod(), above(-5e-6)).wrench[0][2], 3 * k * 5e-6, 1e-9);
}

// A face turned away that is deeper than two fifths of the alarm distance where it first appears, as a cut's
// may be: no row pushes it out, and what is lost is told. Deeper than half of that distance, and the
// instrument is no longer outside.
TEST(Outside, WhatIsDeepAlreadyIsLost) {
  for (const double depth : {0.15e-3, 0.17e-3, 0.23e-3}) {
    Faces flap;
    flap.add(Vec3(-0.5e-3, 0, 0), true);
    ContactLoop loop;
    for (int tick = 0; tick < 3; ++tick) loop.solve(*flap.problem, rod(), above(-20e-6));
    ASSERT_TRUE(loop.state.memory.outside[0]);
    flap.add(Vec3(0.5e-3, 0, depth - 20e-6), false);
    const ContactSolution solution = loop.solve(*flap.problem, rod(), above(-20e-6));
    const bool held = depth < 0.16e-3;
    EXPECT_NEAR(solution.wrench[0][2], 3 * k * (20e-6 + (held ? depth : 0)), 1e-9);
    EXPECT_NEAR(solution.lost, held ? 0 : depth, 1e-12);
    EXPECT_EQ(loop.state.memory.outside[0], depth < 0.2e-3);
  }
}

// … nor where it is deeper than three fifths of what it is inside of is thick.
TEST(Outside, TowardsTheAxisOfAThinRodNothingIsHeld) {
  for (const double depth : {0.05e-3, 0.07e-3}) {
    Faces flap;
    flap.add(Vec3(-0.5e-3, 0, 0), true);
    Instrument thin = rod();
    const Vec3 down(0, 0, thin.primitives[0].radius - 0.1e-3);  // its lower side stays where it is
    thin.primitives[0].radius = 0.1e-3;
    thin.primitives[0].placement.p -= down;
    ContactLoop loop;
    for (int tick = 0; tick < 3; ++tick) loop.solve(*flap.problem, thin, above(-20e-6));
    ASSERT_TRUE(loop.state.memory.outside[0]);
    flap.add(Vec3(0.5e-3, 0, depth - 20e-6), false);
    const ContactSolution solution = loop.solve(*flap.problem, thin, above(-20e-6));
    EXPECT_NEAR(solution.lost, depth < 0.06e-3 ? 0 : depth, 1e-12);
  }
}

// … until no more than an eighth of the alarm distance is inside: then it is outside again, and held.
TEST(Outside, WhatIsHardlyInsideIsHeldAgain) {
  Faces flap;
  flap.add(Vec3(-0.5e-3, 0, 0), true);
  flap.add(Vec3(0.5e-3, 0, 0.13e-3), false);
  ContactLoop loop;
  const auto far_side_at = [&](double z) {
    for (int n = 3; n < 6; ++n) flap.problem->x_free[n].z() = z;
    flap.problem->x_now = flap.problem->x_free;
    return loop.solve(*flap.problem, rod(), above(-20e-6));
  };
  for (const double depth : {150e-6, 70e-6, 52e-6}) {
    EXPECT_NEAR(far_side_at(depth - 20e-6).lost, depth, 1e-12);
    EXPECT_FALSE(loop.state.memory.outside[0]) << depth;
  }
  far_side_at(28e-6);
  EXPECT_TRUE(loop.state.memory.outside[0]);
  const ContactSolution held = far_side_at(28e-6);
  EXPECT_LT(held.penetration, 1e-12);
  EXPECT_NEAR(held.wrench[0][2], 3 * k * (20e-6 + 48e-6), 1e-9);
}

}  // namespace
}  // namespace hapticd
