// A shaft in its ring, against hand answers: force k (offset − slack), Coulomb's law along it and about it.
#include "physics/contact/incision/incision_rows.h"

#include <gtest/gtest.h>

#include <memory>

#include "physics/contact/contact_solve.h"
#include "tests/support/bodies.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

constexpr double depth = 6e-3, slack = 0.1e-3, k = 800, mu = 0.3, radius = 0.4e-3;
constexpr double K = 50, K_r = 1.25e-3;

// A shaft of 40 mm along z whose tip is 6 mm below its ring.
Instrument shaft(double friction) {
  Primitive rod;
  rod.shape = Shape::capsule;
  rod.radius = radius;
  rod.half_length = 20e-3;
  rod.placement.p = Vec3(0, 0, 20e-3);
  Instrument instrument;
  instrument.primitives = {rod};
  instrument.incision = {Vec3(0, 0, depth), Vec3::UnitZ(), slack, k, friction};
  return instrument;
}

struct Ring {
  Instrument instrument;
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();
  std::unique_ptr<ContactScratch> scratch = std::make_unique<ContactScratch>();
  ContactState state;
  ContactOptions options;
  ContactSolution solution;

  // Held by a coupling, or rigidly.
  explicit Ring(double friction, bool coupled = false) : instrument(shaft(friction)) {
    problem->step = 1;
    problem->alarm_distance = 0.5e-3;
    if (coupled) problem->instrument[0].coupling = {K, K_r, 0};
  }
  Vec6 at(const Pose& X) {
    solution = solve_contact(*problem, instrument, X, 1e-3, options, state, *scratch);
    EXPECT_EQ(solution.status, SolveStatus::solved);
    return solution.wrench[0];
  }
  Vec6 at(double x, double z = 0, double turn = 0) {
    return at(Pose{Vec3(x, 0, z), Quat(Eigen::AngleAxisd(turn, Vec3::UnitZ()))});
  }
  double offset() const {
    const Pose& X = solution.instrument[0];
    const Vec3 z = X.q * Vec3::UnitZ(), v = X.p - instrument.incision.at;
    return (v - z * z.dot(v)).norm();
  }
};

TEST(Incision, ARigidlyHeldShaftIsPushedBackByTheRingsStiffness) {
  Ring ring(0);
  for (double x = 0; x < 1e-3; x += 17e-6) {
    const Vec6 f = ring.at(x);
    const double expected = k * std::max(0.0, x - slack);
    EXPECT_NEAR(f[0], -expected, 1e-9 * k * x) << x;
    EXPECT_NEAR(f[4], depth * f[0], 1e-12) << "at the ring, not at the tip";
    EXPECT_LT(f.segment<3>(1).norm() + std::abs(f[5]), 1e-12);
  }
}

// Wherever it is aside: the direction is the offset's.
TEST(Incision, PushesBackTheWayItWasPressed) {
  Ring ring(0);
  for (int i = 0; i < 24; ++i) {
    const Vec3 aside(std::cos(i * 0.26), std::sin(i * 0.26), 0);
    ring.at(0);
    const Vec6 f = ring.at(Pose{0.3e-3 * aside, Quat::Identity()});
    EXPECT_LT((f.head<3>() + k * 0.2e-3 * aside).norm(), 1e-9);
  }
}

// Two springs in line: the coupling at the ring, 1/K + L²/K_r, and the ring.
TEST(Incision, ACoupledShaftSharesTheWayWithItsCoupling) {
  Ring ring(0, true);
  ring.at(0.0);
  const double x = slack + 50e-6;
  for (int i = 0; i < 10; ++i) ring.at(x);
  const double force = 50e-6 / (1 / K + depth * depth / K_r + 1 / k);
  EXPECT_NEAR(-ring.solution.wrench[0][0], force, 1e-3 * force);
  EXPECT_NEAR(-ring.solution.wrench[0][0], k * (ring.offset() - slack), 1e-4 * force);
}

TEST(Incision, NothingIsFeltWithinTheSlackNorOutsideTheBody) {
  Ring ring(mu, true);
  std::srand(5);
  for (int i = 0; i < 2000; ++i) {
    const Vec3 r = Vec3::Random();
    const Vec3 tip = 0.3e-3 * r, axis(0.007 * r.y(), 0.007 * r.z(), 1);  // at the ring within 72 µm of …
    const Vec3 at_ring = tip + axis * (depth - tip.z());
    const Vec3 p = tip - Vec3(at_ring.x(), at_ring.y(), 0) + Vec3(0.05e-3 * r.z(), 0.05e-3 * r.x(), 0);
    const Pose X{p, Quat::FromTwoVectors(Vec3::UnitZ(), axis) * Quat(Eigen::AngleAxisd(i, Vec3::UnitZ()))};
    EXPECT_TRUE(ring.at(X).isZero(0)) << i;
  }
  EXPECT_EQ(ring.solution.contacts, 1);
  EXPECT_TRUE(ring.at(5e-3, depth + 1e-6).isZero(0));
  EXPECT_EQ(ring.solution.contacts, 0);
}

// Along the shaft: k s until μ N, then μ N; back the same way, within ± μ N.
TEST(Incision, SticksAndSlipsAlongTheShaftByCoulomb) {
  Ring ring(mu);
  ring.at(0.0);
  const double x = slack + 0.2e-3, most = mu * k * 0.2e-3;
  ring.at(x);
  double force = 0, z = 0, before = 0;
  const auto go = [&](double to, double step) {
    for (; (to - z) * step > 1e-12; z += step) {
      const Vec6 f = ring.at(x, z);
      force = std::clamp(force - k * (z - before), -most, most);
      before = z;
      EXPECT_NEAR(f[2], force, 2e-6 * most) << z;
      EXPECT_NEAR(f[0], -k * 0.2e-3, 1e-6 * most);
    }
  };
  go(0.3e-3, 4e-6);
  EXPECT_EQ(force, -most);
  go(-0.2e-3, -4e-6);
  EXPECT_EQ(force, most);
  for (int i = 0; i < 2000; ++i) EXPECT_NEAR(ring.at(x, before)[2], force, 2e-6 * most) << "held it stays";
}

// About it: the ring holds its surface, R from the axis.
TEST(Incision, SticksAndSlipsAboutTheShaftByCoulomb) {
  Ring ring(mu);
  ring.at(0.0);
  const double x = slack + 0.2e-3, most = mu * k * 0.2e-3;
  for (double turn = 0; turn < 0.5; turn += 5e-3) {
    const double f = std::min(most, k * radius * turn);
    EXPECT_NEAR(ring.at(x, 0, turn)[5], -radius * f, 0.01 * radius * most) << turn;
  }
}

// Who begins aside is not pushed; the ring closes behind a shaft that comes in, and then holds it.
TEST(Incision, ClosesBehindAShaftThatComesIn) {
  Ring ring(0);
  for (const double x : {1e-3, 0.8e-3, 0.5e-3}) EXPECT_TRUE(ring.at(x).isZero(0)) << x;
  EXPECT_NEAR(ring.at(0.7e-3)[0], -k * 0.2e-3, 1e-9);
  ring.at(0.0);
  EXPECT_NEAR(ring.at(0.7e-3)[0], -k * 0.6e-3, 1e-9);
}

// Tip against a wall, shaft against the ring, from the same side: two rows that share the coupling.
TEST(Incision, AndTissueAreSolvedTogether) {
  constexpr double wall = 0.2e-3, x = 0.35e-3;
  Ring ring(0, true);
  ring.problem->samples = 1;
  ring.problem->sample[0] = {1, {-1, -1, -1}, {1, 0, 0}, Vec3(radius + wall, 0, 0), -Vec3::UnitX(), 0};
  for (int i = 0; i <= 70; ++i) ring.at(5e-6 * i);
  for (int i = 0; i < 20; ++i) ring.at(x);
  Eigen::Matrix2d W;
  W << 1 / K * 1.001, 1 / K, 1 / K, 1 / K + depth * depth / K_r + 1 / k;
  const Eigen::Vector2d force = W.inverse() * Eigen::Vector2d(x - wall, x - slack);
  ASSERT_GT(force.minCoeff(), 0);
  EXPECT_NEAR(-ring.solution.wrench[0][0], force.sum(), 3e-3 * force.sum());
  EXPECT_NEAR(-ring.solution.wrench[0][4], depth * force[1], 3e-2 * depth * force[1]);
  EXPECT_NEAR(ring.offset(), slack + force[1] / k, 1e-6);
}

// The simulation's step has the same rows.
TEST(Incision, TheStepHoldsTheShaftToo) {
  std::vector<BodySettings> bodies;
  bodies.push_back(block("tissue", {2e-3, 2e-3, 1e-3}, {2, 2, 1}, {20e3, 0.4, 1000, 2, 2e-3},
                         {Vec3(0.05, 0, 0), Quat::Identity()}));
  WorldSettings s = contact_world({});
  s.alarm_distance = 0.3e-3;
  s.sample_spacing = 0.3e-3;
  s.coupling[0] = {K, K_r, 0};
  World world(std::move(bodies), shaft(0), s);
  const auto problem = std::make_unique<CondensedProblem>();
  InstrumentSample hand = at(Vec3::Zero());
  StepReport report;
  for (int i = 0; i < 20; ++i) {
    hand.pose.p.x() = std::min(15e-6 * i, slack + 50e-6);
    report = world.step([&] { return InstrumentSamples(hand); }, *problem);
  }
  const double force = 50e-6 / (1 / K + depth * depth / K_r + 1 / k);
  EXPECT_NEAR(-report.contact.wrench[0][0], force, 2e-3 * force);
}

// Before it has met tissue a tip begins where tissue is, not where it would be if nobody held it.
TEST(Incision, ARingSaysNothingOfTissue) {
  const auto problem = spring_problem(100, Vec3::Zero(), 0);
  problem->x_free[0] = Vec3(0, 0, 1e-3);
  const auto memory = std::make_unique<ContactMemory>();
  memory->count = 1;
  memory->entry[0] = {incision_id(0), Vec3(1e-3, 0, 0), Vec3::Zero(), false};
  PatchPositions x;
  displaced_patch(*problem, *memory, x);
  EXPECT_EQ(x[0], problem->x_now[0]);
  EXPECT_NE(x[0], problem->x_free[0]);
}

}  // namespace
}  // namespace hapticd
