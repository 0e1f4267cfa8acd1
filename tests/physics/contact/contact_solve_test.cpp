#include "physics/contact/contact_solve.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "tests/support/contact_loop.h"
#include "tests/support/contact_problems.h"
#include "tests/support/malloc_guard.h"

namespace hapticd {
namespace {

constexpr double T = 1e-3;

struct Sheet {
  std::unique_ptr<CondensedProblem> problem;
  Instrument instrument = sphere_instrument(4e-3);

  // Many contacts at once: a blunt sphere on a sheet that dents locally.
  explicit Sheet(double friction) {
    Random random(1);
    SheetSettings settings;
    settings.nodes = 7;
    settings.per_triangle = 3;
    settings.reach = 1e-3;
    settings.friction = friction;
    problem = sheet_problem(random, settings);
    problem->instrument[0].X_ref = at(0);
  }

  // Sphere with its lowest point `depth` below the undeformed sheet, off its symmetry.
  static Pose at(double depth, double along = 0) {
    return {Vec3(0.31e-3 + along, -0.17e-3, 4e-3 - depth), Quat::Identity()};
  }
};

TEST(ContactSolve, FreeSpaceGivesZero) {
  for (const double friction : {0.0, 0.3}) {
    const Sheet s(friction);
    ContactLoop loop;
    const ContactSolution out = loop.solve(*s.problem, s.instrument, Sheet::at(-0.1e-3));
    EXPECT_GT(out.contacts, 0);  // rows exist before touch
    EXPECT_EQ(out.active, 0);
    EXPECT_TRUE(out.wrench[0].isZero(0));
    EXPECT_EQ(out.penetration, 0);
    EXPECT_EQ(loop.solve(*s.problem, s.instrument, Sheet::at(-5e-3)).contacts, 0);
  }
}

// Tissue spring k and coupling K in series under a sphere that goes d down: f = d / (1/k + 1/K_eff), at once
// with K_eff = K (1 + B/(K T)), at rest with K.
TEST(ContactSolve, SphereOnASpringIsTwoSpringsInSeries) {
  const double k = 40, K = 300, damping_time = 2e-3, depth = 0.3e-3;
  for (const double friction : {0.0, 0.4})
    for (const Renewal renewal : {Renewal::renewed, Renewal::frozen}) {
      const auto problem = spring_problem(k, Vec3::Zero(), friction);
      problem->instrument[0].coupling = {K, 0.05, damping_time};
      problem->renewal = renewal;
      problem->instrument[0].X_ref = {Vec3(0, 0, 1e-3), Quat::Identity()};
      const Instrument instrument = sphere_instrument(1e-3);
      const Pose X{Vec3(0, 0, 1e-3 - depth), Quat::Identity()};
      ContactLoop loop;
      ContactSolution out = loop.solve(*problem, instrument, X);
      const double at_once = depth / (1 / k + 1 / (K * (1 + damping_time / T)));
      EXPECT_NEAR(out.wrench[0][2], at_once, 1e-8 * at_once);
      for (int tick = 0; tick < 200; ++tick) out = loop.solve(*problem, instrument, X);
      const double at_rest = depth / (1 / k + 1 / K);
      EXPECT_NEAR(out.wrench[0][2], at_rest, 1e-8 * at_rest);
      EXPECT_LT(out.wrench[0].head<2>().norm() + out.wrench[0].tail<3>().norm(), 1e-8 * at_rest);
      EXPECT_NEAR(out.instrument[0].p.z() - X.p.z(), at_rest / K, 1e-8 * depth);
      EXPECT_NEAR(loop.scratch->x[0].z(), -at_rest / k, 1e-8 * depth);
      EXPECT_LT(out.penetration, 1e-8 * depth);
      EXPECT_EQ(out.active, 1);
    }
}

TEST(ContactSolve, NoCouplingStiffnessMeansHeldRigidly) {
  const auto problem = spring_problem(40, Vec3::Zero(), 0);
  const Instrument instrument = sphere_instrument(1e-3);
  ContactLoop loop;
  const ContactSolution out = loop.solve(*problem, instrument, {Vec3(0, 0, 0.7e-3), Quat::Identity()});
  EXPECT_NEAR(out.wrench[0][2], 40 * 0.3e-3, 1e-9);
  EXPECT_EQ(out.instrument[0].p.z(), 0.7e-3);
}

TEST(ContactSolve, RigidObstacleIsFeltThroughTheCouplingAlone) {
  for (const double friction : {0.0, 0.4}) {
    const auto problem = spring_problem(1, Vec3::Zero(), friction);
    problem->nodes = 0;
    problem->sample[0].node = {-1, -1, -1};
    problem->instrument[0].coupling = {300, 0.05, 0};
    ContactLoop loop;
    ContactSolution out;
    for (int tick = 0; tick < 50; ++tick)
      out = loop.solve(*problem, sphere_instrument(1e-3), {Vec3(0, 0, 0.7e-3), Quat::Identity()});
    EXPECT_NEAR(out.wrench[0][2], 300 * 0.3e-3, 2e-3 * 300 * 0.3e-3);
    EXPECT_LT(out.penetration, 2e-3 * 0.3e-3);
  }
}

// Without friction and damping the wrench is minus the gradient, by the device's twist, of the energy
// ½ fᵀC f + ½ eᵀK e that tissue and coupling hold.
TEST(ContactSolve, WrenchIsTheGradientOfTheStoredEnergy) {
  Sheet s(0.0);
  s.problem->instrument[0].coupling.damping_time = 0;
  s.instrument.primitives[0].placement.p = {0.4e-3, 0.2e-3, 0};  // so that there is a torque
  Vec6 wrench;
  const auto energy = [&](const Pose& X) {
    ContactLoop loop;
    loop.options.linearisations = 60;
    const ContactSolution out = loop.solve(*s.problem, s.instrument, X);
    wrench = out.wrench[0];
    const VecX f = dense_H(*s.problem, loop.scratch->rows).transpose() *
                   Eigen::Map<const VecX>(loop.scratch->lambda.data(), loop.scratch->rows.rows());
    const Vec6 e = difference(X, out.instrument[0]);
    return 0.5 * f.dot(s.problem->C() * f) +
           0.5 * s.problem->instrument[0].coupling.stiffness * e.head<3>().squaredNorm() +
           0.5 * s.problem->instrument[0].coupling.rotational_stiffness * e.tail<3>().squaredNorm();
  };
  const Pose X = Sheet::at(0.3e-3);
  const double h = 1e-7;
  Vec6 gradient;
  for (int c = 0; c < 6; ++c) {
    const double step = c < 3 ? h : h / 2e-3;
    const Vec6 d = step * Vec6::Unit(c);
    gradient[c] = (energy(displaced(X, d)) - energy(displaced(X, -d))) / (2 * step);
  }
  energy(X);
  EXPECT_GT(wrench[2], 1e-3);
  EXPECT_LT((wrench + gradient).head<3>().norm(), 1e-4 * wrench.head<3>().norm());
  EXPECT_LT((wrench + gradient).tail<3>().norm(), 1e-4 * wrench.head<3>().norm() * 2e-3);
}

// Where nothing turns, one linearisation is as good as two; where much does, it is not left out. Each
// linearisation has a W of its own.
TEST(ContactSolve, WhatHardlyTurnsIsNotLinearisedAgain) {
  for (const double friction : {0.0, 0.3}) {
    const Sheet s(friction);
    ContactLoop all, fewer;
    fewer.options.turned = 2e-3;
    const auto both = [&](const Pose& X) {
      const std::uint64_t before = fewer.scratch->matrix_version;
      const Vec6 expected = all.solve(*s.problem, s.instrument, X).wrench[0];
      const Vec6 found = fewer.solve(*s.problem, s.instrument, X).wrench[0];
      EXPECT_LT((found - expected).head<3>().norm(), 2e-3 * expected.head<3>().norm());
      return fewer.scratch->matrix_version - before;
    };
    EXPECT_GE(both(Sheet::at(0.3e-3)), 2u);
    both(Sheet::at(0.3e-3));
    std::uint64_t linearisations = 0;
    for (int tick = 1; tick <= 20; ++tick) linearisations += both(Sheet::at(0.3e-3 + 0.2e-6 * tick));
    EXPECT_EQ(linearisations, 20u) << "friction " << friction;
    EXPECT_GE(both(Sheet::at(0.3e-3, 0.4e-3)), 2u);
  }
}

// The simulation solves cold, the haptic loop comes from a history: at equal poses the forces are equal.
TEST(ContactSolve, TwoLoopsAgreeAtEqualPoses) {
  Sheet s(0.0);
  s.problem->instrument[0].coupling.damping_time = 0;
  ContactLoop haptic, simulation;
  haptic.options.linearisations = simulation.options.linearisations = 60;
  for (int tick = 0; tick < 20; ++tick) {
    const Pose X = Sheet::at(0.4e-3 * std::sin(0.3 * tick), 0.3e-3 * std::cos(0.2 * tick));
    const Vec6 warm = haptic.solve(*s.problem, s.instrument, X).wrench[0];
    simulation.state = {};
    const Vec6 cold = simulation.solve(*s.problem, s.instrument, X).wrench[0];
    EXPECT_LT((warm - cold).norm(), 1e-9 * std::max(cold.norm(), 1e-3)) << tick;
  }
}

TEST(ContactSolve, EqualHistoriesGiveEqualForcesWithFriction) {
  for (const Renewal renewal : {Renewal::renewed, Renewal::frozen}) {
    Sheet s(0.3);
    s.problem->renewal = renewal;
    ContactLoop a, b;
    for (int tick = 0; tick < 50; ++tick) {
      const Pose X = Sheet::at(0.3e-3, 1e-5 * tick);
      const Vec6 first = a.solve(*s.problem, s.instrument, X).wrench[0];
      EXPECT_LT((first - b.solve(*s.problem, s.instrument, X).wrench[0]).norm(), 1e-9 * first.norm());
    }
  }
}

// Frozen rows are the renewed ones' linearisation: the difference falls with the depth.
TEST(ContactSolve, FrozenAndRenewedAgreeInTheLimitOfSmallDepth) {
  for (const double friction : {0.0, 0.3}) {
    double previous = 0;
    for (const double depth : {160e-6, 80e-6, 40e-6}) {
      Sheet s(friction);
      s.problem->instrument[0].X_ref = Sheet::at(depth);
      ContactLoop renewed, frozen;
      renewed.options.linearisations = 30;
      const Vec6 a = renewed.solve(*s.problem, s.instrument, s.problem->instrument[0].X_ref).wrench[0];
      s.problem->renewal = Renewal::frozen;
      const Vec6 b = frozen.solve(*s.problem, s.instrument, s.problem->instrument[0].X_ref).wrench[0];
      const double apart = (a - b).norm() / a.norm();
      EXPECT_GT(a[2], 0);
      if (previous > 0) {
        EXPECT_LT(apart, 0.5 * previous);
      }
      previous = apart;
    }
    EXPECT_LT(previous, 5e-3);
  }
}

// Push down, drag within the cone, hold: the tangential force must not creep.
TEST(ContactSolve, StickDoesNotCreep) {
  for (const Renewal renewal : {Renewal::renewed, Renewal::frozen}) {
    Sheet s(0.8);
    s.problem->renewal = renewal;
    ContactLoop loop;
    loop.options.margin = 0.04e-3;
    for (int tick = 0; tick <= 30; ++tick) loop.solve(*s.problem, s.instrument, Sheet::at(0.01e-3 * tick));
    for (int tick = 0; tick <= 20; ++tick)
      loop.solve(*s.problem, s.instrument, Sheet::at(0.3e-3, 3e-6 * tick));
    ContactSolution held;
    const Pose hold = Sheet::at(0.3e-3, 60e-6);
    for (int tick = 0; tick < 200; ++tick) held = loop.solve(*s.problem, s.instrument, hold);
    EXPECT_LT(held.wrench[0][0], -1e-4);  // dragged towards +x, pulled back
    ContactSolution later;
    for (int tick = 0; tick < 10000; ++tick) later = loop.solve(*s.problem, s.instrument, hold);
    EXPECT_LT((later.wrench[0] - held.wrench[0]).norm(), 1e-9 * held.wrench[0].norm());
  }
}

TEST(ContactSolve, DraggedContactSlidesWithMuTimesNormalForce) {
  const double mu = 0.25;
  const auto problem = spring_problem(40, Vec3::Zero(), mu);
  problem->instrument[0].coupling = {300, 0.0, 0};
  Primitive plate;  // a wide flat end, so that the normal stays vertical
  plate.shape = Shape::cylinder;
  plate.radius = 20e-3;
  plate.half_length = 1e-3;
  Instrument instrument;
  instrument.primitives.push_back(plate);
  ContactLoop loop;
  ContactSolution out;
  for (int tick = 0; tick < 1500; ++tick)
    out = loop.solve(*problem, instrument, {Vec3(5e-6 * tick, 0, 1e-3 - 0.3e-3), Quat::Identity()});
  const double normal_force = 0.3e-3 / (1.0 / 40 + 1.0 / 300);
  EXPECT_NEAR(out.wrench[0][2], normal_force, 1e-6 * normal_force);
  EXPECT_NEAR(out.wrench[0][0], -mu * normal_force, 1e-6 * normal_force);
  EXPECT_NEAR(out.wrench[0][1], 0, 1e-6 * normal_force);
  EXPECT_NEAR(loop.scratch->x[0].x(), mu * normal_force / 40, 1e-6 * 0.3e-3);
}

// Held below the cone the single spring follows the drag: both springs in series sideways too.
TEST(ContactSolve, StickingContactPullsLikeTwoSpringsInSeries) {
  const auto problem = spring_problem(40, Vec3::Zero(), 0.9);
  problem->instrument[0].coupling = {300, 0.0, 0};
  Primitive plate;
  plate.shape = Shape::cylinder;
  plate.radius = 20e-3;
  plate.half_length = 1e-3;
  Instrument instrument;
  instrument.primitives.push_back(plate);
  ContactLoop loop;
  loop.solve(*problem, instrument, {Vec3(0, 0, 1e-3 - 0.3e-3), Quat::Identity()});
  ContactSolution out;
  for (int tick = 0; tick <= 100; ++tick)
    out = loop.solve(*problem, instrument, {Vec3(1e-6 * tick, 0, 1e-3 - 0.3e-3), Quat::Identity()});
  EXPECT_NEAR(out.wrench[0][0], -100e-6 / (1.0 / 40 + 1.0 / 300), 1e-8);
}

TEST(ContactSolve, PenetrationIsLeftOnlyByTheLinearisation) {
  for (const double friction : {0.0, 0.3}) {
    const Sheet s(friction);
    ContactLoop loop;
    ContactSolution out;
    for (int tick = 0; tick <= 30; ++tick)
      out = loop.solve(*s.problem, s.instrument, Sheet::at(0.01e-3 * tick));
    EXPECT_LT(out.penetration, 1e-6);
    EXPECT_GT(out.active, 1);
    EXPECT_EQ(out.status, SolveStatus::solved);
  }
}

TEST(ContactSolve, NotFinitePoseGivesZeroForceAndForgets) {
  for (const Renewal renewal : {Renewal::renewed, Renewal::frozen}) {
    Sheet s(0.3);
    s.problem->renewal = renewal;
    ContactLoop loop;
    const Vec6 before = loop.solve(*s.problem, s.instrument, Sheet::at(0.2e-3)).wrench[0];
    Pose broken = Sheet::at(0.2e-3);
    broken.p.x() = std::numeric_limits<double>::quiet_NaN();
    const ContactSolution out = loop.solve(*s.problem, s.instrument, broken);
    EXPECT_EQ(out.status, SolveStatus::not_finite);
    EXPECT_TRUE(out.wrench[0].isZero(0));
    const Vec6 after = loop.solve(*s.problem, s.instrument, Sheet::at(0.2e-3)).wrench[0];
    EXPECT_LT((after - before).norm(), 1e-9 * before.norm());
  }
}

TEST(ContactSolve, AllocatesNothing) {
  if (!MallocGuard::available()) GTEST_SKIP() << "malloc belongs to the sanitizer";
  for (const double friction : {0.0, 0.3})
    for (const Renewal renewal : {Renewal::renewed, Renewal::frozen}) {
      Sheet s(friction);
      s.problem->renewal = renewal;
      ContactLoop loop;
      int active = 0;
      long allocations = 0, frees = 0;
      {
        const MallocGuard guard;
        for (int tick = 0; tick < 60; ++tick) {
          s.problem->step = static_cast<std::uint64_t>(1 + tick / 20);
          active += loop.solve(*s.problem, s.instrument, Sheet::at(0.01e-3 * tick, 5e-6 * tick)).active;
        }
        allocations = guard.allocations();
        frees = guard.frees();
      }
      EXPECT_GT(active, 100);
      EXPECT_EQ(allocations, 0);
      EXPECT_EQ(frees, 0);
    }
}

TEST(MallocGuard, CountsNewMallocAndEigenOnThisThread) {
  if (!MallocGuard::available()) GTEST_SKIP() << "malloc belongs to the sanitizer";
  const MallocGuard guard;
  {
    const auto boxed = std::make_unique<int>(1);
    const volatile int seen = *boxed;
    EXPECT_EQ(seen, 1);
  }
  EXPECT_EQ(guard.allocations(), 1);
  EXPECT_EQ(guard.frees(), 1);
  const VecX v = VecX::Constant(1000, 1.0);
  EXPECT_EQ(v.sum(), 1000);
  EXPECT_EQ(guard.allocations(), 2);
}

TEST(MallocGuardDeathTest, ForbidEndsTheProcess) {
  if (!MallocGuard::available()) GTEST_SKIP() << "malloc belongs to the sanitizer";
  EXPECT_DEATH(
      {
        const MallocGuard guard(MallocGuard::Mode::forbid);
        const VecX v = VecX::Constant(1000, 1.0);
        EXPECT_EQ(v.sum(), 1000);
      },
      "forbidden");
}

}  // namespace
}  // namespace hapticd
