#include "physics/contact/missed_contact.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/contact_loop.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

// A tip pressed deep into soft tissue, which would spring back by more than the tip's radius without it.
struct Pocket {
  std::unique_ptr<CondensedProblem> problem;
  Instrument instrument = sphere_instrument(0.6e-3);
  ContactLoop loop;

  Pocket() {
    Random random(3);
    SheetSettings settings;
    settings.nodes = 9;
    settings.side = 4e-3;
    settings.compliance = 0.15;
    settings.reach = 1e-3;
    problem = sheet_problem(random, settings);
    problem->alarm_distance = 0.8e-3;
    loop.options.margin = 0.2e-3;
    loop.options.linearisations = 3;
  }
  static Pose at(double depth) { return {Vec3(0.05e-3, 0.02e-3, 0.6e-3 - depth), Quat::Identity()}; }

  double force_at(double depth) { return loop.solve(*problem, instrument, at(depth)).wrench[0][2]; }
  // The way a hand goes: 20 µm a solve.
  double go(double from, double to) {
    double force = 0;
    const int solves = static_cast<int>(std::lround(std::abs(to - from) / 20e-6));
    for (int k = 0; k <= solves; ++k) force = force_at(from + (to - from) * k / solves);
    return force;
  }
};

// The last solve's forces press the sheet away from a tip that has gone: almost none of it is within reach of
// rows, and what is not would be met from inside, or not at all.
TEST(MissedContact, ATipThatRetractsWithinOneSolveKeepsItsContact) {
  for (const double back : {0.2e-3, 0.3e-3, 0.4e-3}) {
    Pocket slow, fast;
    const double deep = slow.go(-0.1e-3, 1.6e-3);
    fast.go(-0.1e-3, 1.6e-3);
    const double expected = slow.go(1.6e-3, 1.6e-3 - back);
    EXPECT_LT(expected, 0.95 * deep);
    EXPECT_GT(expected, 0.3 * deep);
    EXPECT_NEAR(fast.force_at(1.6e-3 - back), expected, 0.05 * expected) << back;
  }
}

// Rows that a solve does without until it would let their samples through change nothing but its cost. With
// friction a sample that is a row for the first time has no place on the tip to have slipped from: there as
// many rows as the next ticks can reach, as the haptic step asks for.
TEST(MissedContact, FewerRowsAtFirstGiveTheSameForces) {
  for (const double mu : {0.0, 0.3}) {
    Pocket all, few;
    for (Pocket* p : {&all, &few})
      for (int k = 0; k < p->problem->samples; ++k) p->problem->sample[k].friction = mu;
    Random random(11);
    std::uniform_real_distribution<double> any(-1, 1);
    int rows = 0, fewer = 0;
    Pose X = Pocket::at(-0.1e-3);
    for (int k = 0; k < 400; ++k) {
      const Vec3 way =
          (k % 20 == 19 ? 60e-6 : 10e-6) * Vec3(any(random), any(random), k < 150 ? -1 : any(random));
      X.p += way;
      few.loop.options.activation_distance = mu > 0 ? std::max(3 * way.norm(), 0.04e-3) : 0.02e-3;
      const ContactSolution a = all.loop.solve(*all.problem, all.instrument, X),
                            b = few.loop.solve(*few.problem, few.instrument, X);
      const double scale = std::max(a.wrench[0].head<3>().norm(), 1e-3);
      EXPECT_LT((a.wrench[0] - b.wrench[0]).head<3>().norm(), 1e-6 * scale) << mu << " " << k;
      rows += a.contacts;
      fewer += b.contacts;
    }
    EXPECT_LT(fewer, 0.7 * rows);
  }
}

// What was missed has a row in the second solve and presses, at a gap of zero to rounding: that is no miss.
TEST(MissedContact, AMissedContactCostsOneMoreSolve) {
  for (const double mu : {0.0, 0.3}) {
    Pocket p;
    for (int k = 0; k < p.problem->samples; ++k) p.problem->sample[k].friction = mu;
    p.go(-0.1e-3, 1.6e-3);
    p.loop.options.linearisations = 1;
    p.loop.options.activation_distance = 0.01e-3;
    int missed = 0;
    for (int k = 1; k <= 10; ++k) {
      const auto before = p.loop.scratch->matrix_version;
      p.force_at(1.6e-3 - 40e-6 * k);
      const auto solves = p.loop.scratch->matrix_version - before;
      missed += solves > 1;
      EXPECT_LE(solves, 3U) << mu << " " << k;
    }
    EXPECT_GT(missed, 0) << mu;
  }
}

// All of the faces under the tip go, and others come to light in their place: a new set of samples.
TEST(MissedContact, ARemovalUnderTheTipKeepsItsContact) {
  Pocket pocket;
  const double before = pocket.go(-0.1e-3, 1.6e-3);
  for (int a = 0; a < pocket.problem->nodes; ++a) pocket.problem->x_now[a] = pocket.loop.scratch->x[a];
  for (int k = 0; k < pocket.problem->samples; ++k) pocket.problem->sample[k].id += 1u << 20;
  EXPECT_NEAR(pocket.force_at(1.6e-3), before, 0.02 * before);
}

}  // namespace
}  // namespace hapticd
