// A poisoned problem: whatever is wrong with it, the force is zero, latched, and nothing of it is remembered.
#include "haptic/contact/problem_check.h"

#include <functional>
#include <limits>

#include <gtest/gtest.h>

#include "haptic/haptic_step.h"
#include "tests/support/contact_problems.h"
#include "tests/support/one_device.h"

namespace hapticd {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN(),
                 inf = std::numeric_limits<double>::infinity();

std::unique_ptr<CondensedProblem> sound_problem() {
  Random random(3);
  auto problem = sheet_problem(random, {.friction = 0.3});
  for (int k = 0; k < 2; ++k)
    problem->edge[k] = {edge_id(0, k),  0,   0, {6, 7, 11, 12}, {0.2, 0.3, 0.4, 0.1}, Vec3::Zero(),
                        -Vec3::UnitZ(), 0.1, 0};
  problem->edges = 2;
  problem->known.count = 1;
  problem->known.entry[0] = {.id = 7, .lambda = Vec3(0, 0, 1), .anchor = Vec3::Zero(), .sticking = true};
  return problem;
}

struct Poison {
  const char* name;
  std::function<void(CondensedProblem&)> give;
};

const Poison poisons[] = {
    {"x_free", [](CondensedProblem& p) { p.x_free[3].x() = nan; }},
    {"x_now", [](CondensedProblem& p) { p.x_now[3].y() = inf; }},
    {"C nan", [](CondensedProblem& p) { p.C()(4, 7) = nan; }},
    {"C infinite", [](CondensedProblem& p) { p.C()(7, 4) = inf; }},
    {"C negative", [](CondensedProblem& p) { p.C()(5, 5) = -p.C()(5, 5); }},
    {"C not symmetric", [](CondensedProblem& p) { p.C()(0, 3) += 0.01 * p.C()(0, 0); }},
    {"C indefinite", [](CondensedProblem& p) { p.C()(0, 3) = p.C()(3, 0) = 1.1 * p.C()(0, 0); }},
    {"one entry of C", [](CondensedProblem& p) { p.C()(0, 0) = 0; }},
    {"weight", [](CondensedProblem& p) { p.sample[2].weight[1] = nan; }},
    {"outward", [](CondensedProblem& p) { p.sample[2].outward.z() = nan; }},
    {"friction", [](CondensedProblem& p) { p.sample[2].friction = -1; }},
    {"coupling", [](CondensedProblem& p) { p.instrument[0].coupling.stiffness = nan; }},
    {"X_ref", [](CondensedProblem& p) { p.instrument[0].X_ref.q.w() = nan; }},
    {"node", [](CondensedProblem& p) { p.sample[2].node[1] = p.nodes; }},
    {"node below", [](CondensedProblem& p) { p.sample[2].node[1] = -1; }},
    {"nodes", [](CondensedProblem& p) { p.nodes = max_patch_nodes + 1; }},
    {"samples", [](CondensedProblem& p) { p.samples = max_patch_samples + 1; }},
    {"edges", [](CondensedProblem& p) { p.edges = max_edge_samples + 1; }},
    {"edge's id", [](CondensedProblem& p) { p.edge[0].id = 5; }},
    {"edge twice", [](CondensedProblem& p) { p.edge[1].id = p.edge[0].id; }},
    {"edge's instrument", [](CondensedProblem& p) { p.edge[1].instrument = max_instruments; }},
    {"edge's node", [](CondensedProblem& p) { p.edge[1].node[3] = p.nodes; }},
    {"edge's node below", [](CondensedProblem& p) { p.edge[1].node[3] = -1; }},
    {"edge's weight", [](CondensedProblem& p) { p.edge[1].weight[3] = nan; }},
    {"edge's place", [](CondensedProblem& p) { p.edge[1].place.x() = inf; }},
    {"edge's direction", [](CondensedProblem& p) { p.edge[1].direction.setZero(); }},
    {"limit", [](CondensedProblem& p) { p.edge[1].limit = -1e-3; }},
    {"limit infinite", [](CondensedProblem& p) { p.edge[1].limit = inf; }},
    {"advance", [](CondensedProblem& p) { p.edge[1].advance = nan; }},
    {"contacts", [](CondensedProblem& p) { p.known.count = max_contacts + 1; }},
    {"contact's force", [](CondensedProblem& p) { p.known.entry[0].lambda.y() = inf; }},
    {"contact's anchor", [](CondensedProblem& p) { p.known.entry[0].anchor.x() = nan; }},
    {"contact's other anchor", [](CondensedProblem& p) { p.known.entry[0].other_anchor.x() = nan; }},
    {"contact's advance", [](CondensedProblem& p) { p.known.entry[0].advance = nan; }},
    {"offset", [](CondensedProblem& p) { p.instrument[0].offset[5] = nan; }},
};

TEST(ProblemCheck, TellsPoisonedFromSound) {
  EXPECT_TRUE(is_sound(*sound_problem()));
  for (const Poison& poison : poisons) {
    const auto p = sound_problem();
    poison.give(*p);
    EXPECT_FALSE(is_sound(*p)) << poison.name;
  }
}

// Whatever its size leaves over beyond the last tile.
TEST(ProblemCheck, EveryEntryOfTheComplianceIsLookedAt) {
  for (const int nodes : {1, 2, 3, 4, 5, 11, 12}) {
    const auto problem = std::make_unique<CondensedProblem>();
    problem->nodes = nodes;
    problem->alarm_distance = 1e-3;
    for (int n = 0; n < nodes; ++n) {
      problem->x_free[n].setZero();
      problem->x_now[n].setZero();
      problem->pull[n].setZero();
    }
    problem->C().setIdentity();
    ASSERT_TRUE(is_sound(*problem)) << nodes;
    for (int i = 0; i < 3 * nodes; ++i)
      for (int j = 0; j < 3 * nodes; ++j)
        for (const double off : {nan, 0.01, 1.1, -1.1}) {
          if (i == j && off > 0) continue;
          const double before = problem->C()(i, j);
          problem->C()(i, j) = off;
          EXPECT_FALSE(is_sound(*problem)) << nodes << ": " << i << ", " << j << " " << off;
          problem->C()(i, j) = before;
        }
  }
}

// Whether it is looked at shows where one that is poisoned is said to be sound; its copy is unknown.
TEST(ProblemCheck, WhatWasLookedAtIsNotLookedAtAgain) {
  for (const bool known : {false, true}) {
    auto state = std::make_unique<HapticState>();
    DeviceSettings device;
    device.max_force = 3;
    const auto p = sound_problem();
    p->sample[0].friction = -1;
    p->known_sound = known;
    const auto copy = std::make_unique<CondensedProblem>();
    copy_in_use(*p, *copy);
    EXPECT_FALSE(copy->known_sound);
    HapticInput in;
    in.device[0].presence.connected = in.device[0].presence.new_client = true;
    in.device[0].taken = in.device[0].sample.enable = true;
    in.device[0].sample.pose.p = Vec3(0, 0, 4e-3 - 0.2e-3);
    std::uint32_t status = 0;
    for (int i = 1; i <= 160; ++i) {
      in.now_ns = in.device[0].sample.received_ns = p->published_ns = (1000 + i) * std::int64_t{1'000'000};
      in.device[0].sample.sequence = static_cast<std::uint64_t>(i);
      status |= haptic_step(p.get(), sphere_instrument(4e-3), device, {}, in, *state).status;
      in.device[0].presence.new_client = false;
    }
    EXPECT_EQ((status & status_not_finite) == 0, known);
  }
}

TEST(ProblemCheck, APoisonedProblemLatchesAndIsForgotten) {
  for (const Poison& poison : poisons) {
    auto state = std::make_unique<HapticState>();
    DeviceSettings device;
    device.max_force = 3;
    device.max_force_rate = 1e4;
    device.max_speed = 10;
    HapticInput in;
    in.device[0].presence.connected = in.device[0].presence.new_client = true;
    in.device[0].taken = in.device[0].sample.enable = true;
    const auto p = sound_problem();
    ForceSample f;
    for (int i = 1; i <= 160; ++i) {
      in.now_ns = in.device[0].sample.received_ns = p->published_ns = (1000 + i) * std::int64_t{1'000'000};
      in.device[0].sample.sequence = static_cast<std::uint64_t>(i);
      in.device[0].sample.pose.p = Vec3(0, 0, 4e-3 - 0.2e-3);
      if (i == 160) {
        EXPECT_GT(f.force.norm(), 1e-3);
        ++p->step;
        poison.give(*p);
      }
      f = haptic_step(p.get(), sphere_instrument(4e-3), device, {}, in, *state);
      in.device[0].presence.new_client = false;
    }
    EXPECT_EQ(f.force.norm(), 0) << poison.name;
    EXPECT_EQ(f.status & (status_not_finite | status_latched), status_not_finite | status_latched)
        << poison.name;
    EXPECT_EQ(state->contact.memory.count, 0);
    EXPECT_EQ(state->patch.step, 0u);
  }
}

}  // namespace
}  // namespace hapticd
