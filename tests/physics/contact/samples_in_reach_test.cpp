// What is kept of the samples in reach: nothing that may be near is ever left out of it.
#include "physics/contact/candidates/samples_in_reach.h"

#include <gtest/gtest.h>

#include <set>

#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

Pose moved(const Pose& X, Random& random, double way, double turn) {
  Vec6 d;
  d << way * unit_vector(random), turn * unit_vector(random);
  return displaced(X, d);
}

// A ball and a long stick, turned at random, walk over a sheet that moves too; every third sample is an
// obstacle's. Whoever is near by `near` itself is in the list, whichever walk it was made for.
TEST(SamplesInReach, HasAllThatAreNearWhereverThingsHaveMoved) {
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    Random random(seed);
    const auto problem = sheet_problem(random, {});
    for (int k = 0; k < problem->samples; k += 3) {
      problem->sample[k].free = sample_position(*problem, problem->x_free, k);
      problem->sample[k].node = {-1, -1, -1};
    }
    std::vector<Instrument> two(2, sphere_instrument(1e-3));
    two[1].primitives[0].shape = Shape::capsule;
    two[1].primitives[0].half_length = 3e-3;
    InstrumentPoses X;
    for (int i = 0; i < 2; ++i) {
      X.present[i] = true;
      X[i] = {Vec3(uniform(random, -3e-3, 3e-3), uniform(random, -3e-3, 3e-3), 1.5e-3),
              random_rotation(random)};
    }
    PatchPositions x = problem->x_free;
    auto kept = std::make_unique<SamplesInReach>();
    const double slack = 0.5e-3;
    int fewer = 0;
    for (int tick = 0; tick < 60; ++tick) {
      kept->keep(1);
      const double reach = tick % 3 == 0 ? 0.05e-3 : 0.4e-3;
      const PlacedInstruments placed(two, X);
      std::set<std::pair<int, int>> listed;
      for (const SamplesInReach::Entry& at : kept->at(*problem, placed, X, x, reach, slack))
        for (int i = 0; i < 2; ++i)
          if (at.near(i)) listed.insert({at.sample, i});
      int pairs = 0;
      for (int k = 0; k < problem->samples; ++k)
        for (int i = 0; i < 2; ++i, ++pairs) {
          const bool near = placed.at(i)->near(sample_position(*problem, x, k), reach);
          EXPECT_TRUE(!near || listed.count({k, i})) << seed << " " << tick << " sample " << k << " of " << i;
        }
      fewer += static_cast<int>(listed.size()) < pairs;
      for (int i = 0; i < 2; ++i) X[i] = moved(X[i], random, 60e-6, 8e-3);
      for (int n = 0; n < problem->nodes; ++n) x[n] += 30e-6 * unit_vector(random);
    }
    EXPECT_GT(fewer, 50) << seed;
  }
}

// An instrument that arrives, and samples of another number, are looked for.
TEST(SamplesInReach, ForgetsWhereItMust) {
  Random random(3);
  const auto problem = sheet_problem(random, {});
  const std::vector<Instrument> two(2, sphere_instrument(1e-3));
  InstrumentPoses X;
  X.present[0] = true;
  X[0] = {Vec3(-2e-3, 0, 0.8e-3), Quat::Identity()};
  X[1] = {Vec3(2e-3, 0, 0.8e-3), Quat::Identity()};
  auto kept = std::make_unique<SamplesInReach>();
  const auto of = [&](int instrument) {
    int count = 0;
    for (const SamplesInReach::Entry& at :
         kept->at(*problem, PlacedInstruments(two, X), X, problem->x_free, 0, 0.2e-3))
      count += at.near(instrument);
    return count;
  };
  kept->keep(1);
  const int first = of(0);
  EXPECT_GT(first, 0);
  EXPECT_EQ(of(1), 0);
  X.present[1] = true;
  EXPECT_GT(of(1), 0);
  X.present[1] = false;
  EXPECT_EQ(of(0), first);
  for (int k = 0; k < problem->samples; ++k) problem->sample[k].node = {-1, -1, -1};
  for (int k = 0; k < problem->samples; ++k) problem->sample[k].free = Vec3(1, 0, 0);
  EXPECT_EQ(of(0), first);
  kept->keep(2);
  EXPECT_EQ(of(0), 0);
}

// A loop that keeps what is in reach from tick to tick answers to the last bit as one that looks each time.
TEST(SamplesInReach, KeptOrNotASolveIsTheSame) {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    Random random(seed);
    SheetSettings settings;
    settings.friction = seed % 2 == 0 ? 0 : 0.3;
    const auto problem = sheet_problem(random, settings);
    problem->step = 1;
    problem->alarm_distance = 1e-3;
    problem->instrument[0].coupling = {400, 0.04, 2e-3};
    const Instrument sphere = sphere_instrument(2e-3);
    ContactState states[2];
    std::unique_ptr<ContactScratch> scratches[2] = {std::make_unique<ContactScratch>(),
                                                    std::make_unique<ContactScratch>()};
    Pose X{Vec3(0, 0, 1.9e-3), Quat::Identity()};
    for (int tick = 0; tick < 100; ++tick) {
      Vec6 wrench[2];
      for (int kept = 0; kept < 2; ++kept) {
        ContactOptions options;
        options.activation_distance = 0.2e-3;
        options.numbered = kept == 1;
        const ContactSolution out =
            solve_contact(*problem, sphere, X, 1e-3, options, states[kept], *scratches[kept]);
        EXPECT_EQ(out.status, SolveStatus::solved);
        wrench[kept] = out.wrench[0];
      }
      EXPECT_EQ(wrench[0], wrench[1]) << seed << " " << tick;
      X = moved(X, random, 20e-6, 5e-3);
    }
  }
}

}  // namespace
}  // namespace hapticd
