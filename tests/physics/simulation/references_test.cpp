// A world whose compliance keeps reference factors that others make, against one that factors at every step.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>

#include "physics/simulation/world.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double h = 0.02;
const Vec3 size(0.02, 0.02, 0.012);

WorldSettings settings(ComplianceMethod method) {
  WorldSettings s;
  s.h = h;
  s.alarm_distance = 2.5e-3;
  s.sample_spacing = 7e-4;
  s.coupling[0] = {500, 0.05, 0};
  s.removal[0] = {10, 5e-4, 1e-3, 50};
  s.compliance = method;
  s.compliance_options.sample_every = 25;
  s.compliance_options.synchronous_reference = false;
  return s;
}

std::unique_ptr<World> block(ComplianceMethod method, int n = 9) {
  Instrument instrument;
  Primitive tip;
  tip.shape = Shape::sphere;
  tip.radius = 2e-3;
  instrument.primitives = {tip};
  BodySettings b{"block", true, box_mesh(size, n, n, n), {5000, 0.4, 1000, 5, 0.002}, {}, 0, true};
  b.fixed_nodes = b.mesh.group("bottom")->nodes;
  std::vector<BodySettings> bodies;
  bodies.push_back(std::move(b));
  return std::make_unique<World>(std::move(bodies), instrument, settings(method));
}

// A stroke across the top at about 12 mm/s, 1.5 mm deep.
InstrumentSample stroke(int step, bool phaco) {
  const double t = step * h;
  const double depth = std::min(1.5e-3, 6e-3 * t - 0.5e-3);
  return {
      {Vec3(0.004 + 0.008 * t, 0.01 + 0.003 * std::sin(3 * t), size.z() + 2e-3 - depth), Quat::Identity()},
      true,
      phaco,
      false};
}

// Reference factors come back `delay` steps after they were asked for, as from a slow thread.
class Maker {
 public:
  explicit Maker(int delay) : delay_(delay) {}
  void between_steps(World& world, int step) {
    for (ReferenceJob& job : world.wanted_references()) {
      job.reference->make();
      jobs_.push_back({step + delay_, std::move(job)});
    }
    while (!jobs_.empty() && jobs_.front().first <= step) {
      world.adopt(std::move(jobs_.front().second));
      jobs_.pop_front();
    }
  }

 private:
  int delay_;
  std::deque<std::pair<int, ReferenceJob>> jobs_;
};

struct Outcome {
  std::vector<double> force;
  int adopted = 0;
  int uncovered_steps = 0;
  int removed = 0;
  double jump_at_swap = 0;  // force against the mean of its neighbours, largest
};

Outcome run(ComplianceMethod method, int delay, bool phaco, int steps = 80) {
  const auto world = block(method);
  Maker maker(delay);
  auto problem = std::make_unique<CondensedProblem>();
  Outcome result;
  std::vector<int> swaps;
  for (int step = 0; step < steps; ++step) {
    const StepReport report = world->step([&] { return stroke(step, phaco); }, *problem);
    result.force.push_back(report.contact.wrench[0].head<3>().norm());
    result.adopted += report.references_adopted;
    result.removed += report.removed;
    result.uncovered_steps += report.uncovered_nodes > 0;
    if (report.references_adopted > 0) swaps.push_back(step);
    maker.between_steps(*world, step);
    for (const BodyReport& b : report.compliance) EXPECT_NE(b.compliance.health, ComplianceHealth::degraded);
  }
  for (const int s : swaps)
    if (s > 0 && s + 1 < steps)
      result.jump_at_swap = std::max(
          result.jump_at_swap, std::abs(result.force[s] - 0.5 * (result.force[s - 1] + result.force[s + 1])));
  return result;
}

double rms(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

TEST(References, ForceUnderMotionIsThatOfExactFactorsWithinOnePercent) {
  const Outcome exact = run(ComplianceMethod::exact, 0, false);
  const double peak = *std::max_element(exact.force.begin(), exact.force.end());
  ASSERT_GT(peak, 1e-3);
  EXPECT_EQ(exact.adopted, 0);
  for (const int delay : {1, 8}) {
    const Outcome zone = run(ComplianceMethod::zone, delay, false);
    std::printf("  delay %d: %d bases, %d steps with uncovered nodes, force off by %.2f %% RMS of the peak\n",
                delay, zone.adopted, zone.uncovered_steps, 100 * rms(zone.force, exact.force) / peak);
    EXPECT_GT(zone.adopted, 3);
    EXPECT_LT(rms(zone.force, exact.force), 0.01 * peak);
  }
}

TEST(References, RemovalsWhileBasesAreMade) {
  const Outcome exact = run(ComplianceMethod::exact, 0, true);
  const Outcome zone = run(ComplianceMethod::zone, 5, true);
  EXPECT_GT(exact.removed, 10);
  EXPECT_EQ(zone.removed, exact.removed);
  const double peak = *std::max_element(exact.force.begin(), exact.force.end());
  std::printf("  %d removed, force off by %.2f %% RMS of the peak\n", zone.removed,
              100 * rms(zone.force, exact.force) / peak);
  EXPECT_LT(rms(zone.force, exact.force), 0.02 * peak);
}

TEST(References, AMakerThatNeverAnswersStopsNothing) {
  const auto world = block(ComplianceMethod::zone, 5);
  auto problem = std::make_unique<CondensedProblem>();
  std::vector<ReferenceJob> jobs;
  for (int step = 0; step < 30; ++step) {
    world->step([&] { return stroke(step, true); }, *problem);
    for (ReferenceJob& job : world->wanted_references()) jobs.push_back(std::move(job));
  }
  ASSERT_EQ(jobs.size(), 1u);  // one at a time
  jobs[0].failed = true;
  world->adopt(std::move(jobs[0]));
  world->step([&] { return stroke(30, true); }, *problem);
  EXPECT_EQ(world->wanted_references().size(), 0u);  // a rest between two
  for (int step = 31; step < 34; ++step) world->step([&] { return stroke(step, true); }, *problem);
  EXPECT_EQ(world->wanted_references().size(), 1u);
}

TEST(References, ExactWantsNone) {
  const auto world = block(ComplianceMethod::exact, 4);
  auto problem = std::make_unique<CondensedProblem>();
  for (int step = 0; step < 10; ++step) {
    world->step([&] { return stroke(step, true); }, *problem);
    EXPECT_TRUE(world->wanted_references().empty());
  }
}

}  // namespace
}  // namespace hapticd
