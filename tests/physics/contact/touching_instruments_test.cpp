// Where two instruments touch: both couplings give way, and Coulomb's law holds between them.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

constexpr double period = 1e-3;
// What a contact without tissue has more of the couplings' compliance, dampers included (delassus.cpp).
constexpr double rigid = 1 + 1e-3;
constexpr double rounding = 1e-8;  // relative; the solver regularises by 1e-9

Primitive part(Shape shape, double radius, double half_length, const Quat& turn = Quat::Identity()) {
  Primitive p;
  p.name = "part";
  p.shape = shape;
  p.radius = radius;
  p.half_length = half_length;
  p.placement.q = turn;
  return p;
}

Instrument of(const Primitive& p) {
  Instrument instrument;
  instrument.primitives = {p};
  return instrument;
}

InstrumentPoses both(const Pose& a, const Pose& b) {
  InstrumentPoses X(a);
  X[1] = b;
  X.present[1] = true;
  return X;
}

Pose at(const Vec3& p) { return {p, Quat::Identity()}; }

// No tissue at all.
struct Air {
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();
  std::vector<Instrument> instruments;
  ContactOptions options;
  ContactState state;
  std::unique_ptr<ContactScratch> scratch = std::make_unique<ContactScratch>();

  Air(Instrument a, Instrument b, VirtualCoupling K_a, VirtualCoupling K_b, double friction = 0)
      : instruments{std::move(a), std::move(b)} {
    problem->step = 1;
    problem->alarm_distance = 1e-3;
    problem->instrument[0].coupling = K_a;
    problem->instrument[1].coupling = K_b;
    problem->instrument_friction = friction;
  }
  ContactSolution solve(const InstrumentPoses& X) {
    return solve_contact(*problem, instruments, X, period, options, state, *scratch);
  }
  ContactSolution hold(const InstrumentPoses& X, int ticks) {
    ContactSolution out;
    for (int t = 0; t < ticks; ++t) out = solve(X);
    return out;
  }
};

// Two balls pushed d into one another: f = d K₁ K₂/(K₁ + K₂), each on its own side.
TEST(TouchingInstruments, TwoBallsAreTwoCouplingsInSeries) {
  const double K_a = 300, K_b = 120, r_a = 1e-3, r_b = 0.6e-3, d = 0.2e-3;
  const Vec3 n = Vec3(1, -2, 0.5).normalized();
  for (const double friction : {0.0, 0.2})
    for (const double damping_time : {0.0, 2e-3}) {
      Air air(of(part(Shape::sphere, r_a, 0)), of(part(Shape::sphere, r_b, 0)), {K_a, 0, damping_time},
              {K_b, 0, damping_time}, friction);
      const InstrumentPoses X = both(at(Vec3(1e-3, 0, 0)), at(Vec3(1e-3, 0, 0) + (r_a + r_b - d) * n));
      const ContactSolution out = air.hold(X, 60);
      const double damped = 1 + damping_time / period;
      const double f = d / ((1 + (rigid - 1) / damped) * (1 / K_a + 1 / K_b));
      EXPECT_LT((out.wrench[0].head<3>() + f * n).norm(), rounding * f);
      EXPECT_LT((out.wrench[1].head<3>() - f * n).norm(), rounding * f);
      EXPECT_LT(out.wrench[0].tail<3>().norm(), rounding * f * r_a);
      EXPECT_EQ(out.active, 1);
      // A damper adds to a coupling while it moves.
      Air at_once(of(part(Shape::sphere, r_a, 0)), of(part(Shape::sphere, r_b, 0)), {K_a, 0, damping_time},
                  {K_b, 0, damping_time}, friction);
      EXPECT_NEAR(at_once.solve(X).wrench[1].head<3>().dot(n), damped * d / (rigid * (1 / K_a + 1 / K_b)),
                  rounding * damped * f);
    }
}

TEST(TouchingInstruments, ApartTheyFeelNothing) {
  Air air(of(part(Shape::sphere, 1e-3, 0)), of(part(Shape::sphere, 1e-3, 0)), {300, 0.01, 0}, {300, 0.01, 0},
          0.2);
  const ContactSolution out = air.hold(both(at({0, 0, 0}), at({2e-3 + 1e-9, 0, 0})), 3);
  EXPECT_EQ(out.contacts, 1);
  EXPECT_EQ(out.active, 0);
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(out.wrench[i].isZero(0));
  EXPECT_EQ(air.solve(both(at({0, 0, 0}), at({5e-3, 0, 0}))).contacts, 0);
}

// Shafts along x and y, d too near to one another along z, met a and b off their middles; turning is held
// rigidly, so that the torque is the force's at its arm.
TEST(TouchingInstruments, CrossedShaftsPressAtTheirNearestPoints) {
  const double K = 200, r = 0.5e-3, d = 0.1e-3, a = 4e-3, b = -3e-3;
  const Quat along_x(Eigen::AngleAxisd(0.5 * M_PI, Vec3::UnitY())),
      along_y(Eigen::AngleAxisd(0.5 * M_PI, Vec3::UnitX()));
  Air air(of(part(Shape::capsule, r, 10e-3, along_x)), of(part(Shape::capsule, r, 10e-3, along_y)), {K, 0, 0},
          {K, 0, 0});
  // Their axes meet, in the plan, at (a, 0): a from the first's middle, b from the second's.
  const ContactSolution out = air.hold(both(at({0, 0, 0}), at({a, -b, 2 * r - d})), 5);
  const double f = d / (rigid * 2 / K);
  EXPECT_LT((out.wrench[0].head<3>() - Vec3(0, 0, -f)).norm(), rounding * f);
  EXPECT_LT((out.wrench[1].head<3>() - Vec3(0, 0, f)).norm(), rounding * f);
  EXPECT_LT((out.wrench[0].tail<3>() - Vec3(a, 0, 0).cross(Vec3(0, 0, -f))).norm(), rounding * f * a);
  EXPECT_LT((out.wrench[1].tail<3>() - Vec3(0, b, 0).cross(Vec3(0, 0, f))).norm(), rounding * f * a);
}

// The first hand's ball on the second's plate: pushed aside by s it sticks, K_s s with both couplings in
// series, and slides at μ N; pulled back it sticks again.
TEST(TouchingInstruments, TheyStickToOneAnotherAndSlideAtTheCone) {
  const double K_a = 300, K_b = 150, mu = 0.25, r = 1e-3, thick = 0.5e-3, d = 0.2e-3;
  const double series = 1 / (rigid * (1 / K_a + 1 / K_b)), N = series * d, slips_at = mu * d;
  Air air(of(part(Shape::sphere, r, 0)), of(part(Shape::cylinder, 8e-3, thick)), {K_a, 0, 0}, {K_b, 0, 0},
          mu);
  const auto pushed = [&](double s) { return air.solve(both(at({s, 0, r + thick - d}), at({0, 0, 0}))); };
  const double step = 2e-6;
  pushed(0);
  double s = 0;
  for (; s < 3 * slips_at; s += step) {
    const ContactSolution out = pushed(s);
    EXPECT_NEAR(out.wrench[0][2], N, 1e-6 * N);
    EXPECT_NEAR(out.wrench[0][0], -std::min(series * s, mu * N), 0.02 * mu * N) << s;
    EXPECT_LT((out.wrench[0] + out.wrench[1]).head<3>().norm(), 1e-14);
  }
  EXPECT_NEAR(pushed(s).wrench[0][0], -mu * N, 1e-6 * N);
  const double most = s;
  for (; s > most - slips_at; s -= step)
    EXPECT_NEAR(pushed(s).wrench[0][0], -mu * N + series * (most - s), 0.02 * mu * N);
}

// One held rigidly is a wall to the other; two of them have nothing that could give way, and no force.
TEST(TouchingInstruments, HeldRigidly) {
  const double K = 300, r = 1e-3, d = 0.1e-3;
  const auto ball = [&] { return of(part(Shape::sphere, r, 0)); };
  const InstrumentPoses X = both(at({0, 0, 0}), at({2 * r - d, 0, 0}));
  for (const double friction : {0.0, 0.3}) {
    Air wall(ball(), ball(), {K, 0, 0}, {0, 0, 0}, friction);
    EXPECT_NEAR(wall.hold(X, 5).wrench[0][0], -K * d / rigid, rounding * K * d);
    Air stiff(ball(), ball(), {0, 0, 0}, {0, 0, 0}, friction);
    const ContactSolution out = stiff.hold(X, 3);
    EXPECT_EQ(out.status, SolveStatus::solved);
    for (int i = 0; i < 2; ++i) EXPECT_TRUE(out.wrench[i].isZero(0));
  }
}

// Tools of ball and shaft, pressed into one another and into a sheet, then held: forces stay from tick to
// tick.
TEST(TouchingInstruments, AHeldPoseHolds) {
  int touching = 0;
  for (const double friction : {0.0, 0.3})
    for (std::uint64_t seed = 1; seed <= 100; ++seed) {
      Random random(seed);
      SheetSettings sheet;
      sheet.nodes = 9;
      sheet.side = 4e-3;
      sheet.friction = friction;
      const auto problem = sheet_problem(random, sheet);
      problem->alarm_distance = 0.8e-3;
      problem->instrument_friction = 0.5 * friction;
      std::vector<Instrument> tools;
      for (int i = 0; i < 2; ++i) {
        problem->instrument[i].coupling = {uniform(random, 50, 300), uniform(random, 1e-3, 1e-2), 2e-3};
        Instrument tool = of(part(Shape::sphere, 0.5e-3, 0));
        Primitive shaft = part(Shape::capsule, 0.4e-3, 3e-3);
        shaft.placement.p.z() = 3e-3;
        tool.primitives.push_back(shaft);
        tools.push_back(tool);
      }
      // Tails apart, tips in the sheet and 0.7 to 1 mm from one another: balls or shafts are in one another.
      const double apart = uniform(random, 0.7e-3, 1.0e-3);
      const auto pose = [&](double side) {
        const Quat lean(Eigen::AngleAxisd(side * uniform(random, -0.15, 0.5), Vec3::UnitY()));
        return Pose{
            Vec3(0.5 * side * apart, uniform(random, -0.2e-3, 0.2e-3), 0.5e-3 - uniform(random, 0, 0.3e-3)),
            lean};
      };
      const Pose a = pose(-1), b = pose(1);
      ContactOptions options;
      options.margin = 0.2e-3;
      ContactState state;
      const auto scratch = std::make_unique<ContactScratch>();
      EachInstrument<Vec6> before;
      for (int t = 0; t < 120; ++t) {
        const double up = 0.6e-3 * std::max(0.0, 1 - t / 40.0);
        InstrumentPoses X = both(a, b);
        X[0].p += Vec3(-up, 0, up);
        X[1].p += Vec3(up, 0, up);
        const ContactSolution out = solve_contact(*problem, tools, X, period, options, state, *scratch);
        if (t >= 100) {
          EXPECT_EQ(out.status, SolveStatus::solved) << seed << ' ' << t;
          for (int i = 0; i < 2; ++i) {
            const Vec3 f = out.wrench[i].head<3>();
            EXPECT_LT((f - before[i].head<3>()).norm(), 0.01 * std::max(f.norm(), 1e-3)) << seed << ' ' << t;
          }
        }
        before = out.wrench;
        if (t != 119) continue;
        const ContactRows& rows = scratch->rows;
        for (int i = 0; i < rows.contacts; ++i)
          touching += rows.row[i].other >= 0 && scratch->lambda[rows.rows_per_contact * i] > 1e-3;
      }
    }
  EXPECT_GT(touching, 100);
}

}  // namespace
}  // namespace hapticd
