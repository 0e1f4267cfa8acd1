// Near regions that follow an instrument, against the same body simulated whole.
#include "physics/simulation/region/region_stage.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>

#include "physics/simulation/region/body_regions.h"
#include "physics/simulation/step/energy_bound.h"
#include "physics/simulation/world.h"
#include "tests/support/bodies.h"

namespace hapticd {
namespace {

const Vec3 size(0.03, 0.02, 0.012);

BodySettings block(bool condensed, bool corotational = true) {
  BodySettings settings = hapticd::block("block", size, {15, 10, 6}, {5000, 0.4, 1000, 5, 2e-3});
  for (std::size_t n = 0; n < settings.mesh.nodes.size(); ++n)
    if (settings.mesh.nodes[n].z() < 1e-9) settings.fixed_nodes.push_back(static_cast<int>(n));
  settings.removable = true;
  settings.corotational = corotational;
  if (condensed) settings.near = NearRegion{Vec3(0.008, 0.01, size.z()), 6e-3, true};
  return settings;
}

WorldSettings pressed(ComplianceMethod method) {
  WorldSettings settings = contact_world({});
  settings.compliance = method;
  settings.alarm_distance = 1.5e-3;
  settings.sample_spacing = 1e-3;
  settings.coupling[0] = {500, 0.05, 0};
  return settings;
}

// A step, and before it all that was asked for, made.
StepReport step(World& world, const InstrumentSample& tip, bool makes = true) {
  static const auto problem = std::make_unique<CondensedProblem>();
  for (ReferenceJob& job : world.wanted_references()) {
    if (!makes && job.kind != JobKind::reference) continue;
    job.reference->make();
    world.adopt(std::move(job));
  }
  return world.step([&] { return tip; }, *problem);
}

// There and back along the block, `deep` in it.
InstrumentSample travelling(int k, double deep, double per_step = 4e-4) {
  const double way = per_step * k, length = 0.012,
               x = 0.008 + (length - std::abs(std::fmod(way, 2 * length) - length));
  return at(Vec3(x, 0.01 + 2e-3 * std::sin(way / 4e-3), size.z() + 2e-3 - std::min(deep, 1e-4 * k)));
}

class FollowingRegions : public testing::TestWithParam<ComplianceMethod> {};

// A press that travels over far more than one region holds.
TEST_P(FollowingRegions, AnswerAsTheWholeBody) {
  World whole({block(false)}, ball(2e-3), pressed(GetParam())),
      near({block(true)}, ball(2e-3), pressed(GetParam()));
  ASSERT_TRUE(near.bodies()[0].regions);
  double peak = 0, off = 0, sum = 0;
  int entered = 0, rigid = 0;
  for (int k = 0; k < 150; ++k) {
    const InstrumentSample tip = travelling(k, 8e-4);
    const Vec3 expected = step(whole, tip).contact.wrench[0].head<3>();
    const StepReport report = step(near, tip);
    const double error = (Vec3(report.contact.wrench[0].head<3>()) - expected).norm();
    entered += report.regions_entered;
    rigid += report.condensed_nodes > 0;
    peak = std::max(peak, expected.norm());
    off = std::max(off, error);
    sum += error * error;
  }
  EXPECT_GT(entered, 6);
  EXPECT_EQ(rigid, 0);
  EXPECT_GT(peak, 1e-3);
  EXPECT_LT(std::sqrt(sum / 150), 0.01 * peak);
  EXPECT_LT(off, 0.04 * peak);
}

INSTANTIATE_TEST_SUITE_P(Methods, FollowingRegions,
                         testing::Values(ComplianceMethod::exact, ComplianceMethod::zone,
                                         ComplianceMethod::lazy),
                         [](const auto& method) {
                           return std::string(method.param == ComplianceMethod::exact  ? "exact"
                                              : method.param == ComplianceMethod::zone ? "zone"
                                                                                       : "lazy");
                         });

// The theorem: of linear tissue at rest under its weight and a load, another region has the same shape where
// both have tissue, and what is new of it is where the whole body has it.
TEST(RegionStage, AnotherRegionGoesOnWhereTheWholeBodyIs) {
  const auto settled = [](bool condensed) {
    BodySettings b = block(condensed, false);
    WorldSettings settings = pressed(ComplianceMethod::exact);
    settings.gravity = Vec3(2, 1, -9.81);
    return std::make_unique<World>(std::vector<BodySettings>{b}, ball(2e-3), settings);
  };
  const auto whole = settled(false), near = settled(true);
  for (int k = 0; k < 400; ++k) {
    step(*whole, nobody());
    step(*near, nobody());
  }
  // The tip comes above the block's other end, and touches nothing.
  const int before = near->bodies()[0].regions->present;
  int entered = 0;
  // Looked at in the step that enters: later what begins elsewhere would have come there by itself.
  for (int k = 0; k < 12 && entered == 0; ++k)
    entered += step(*near, at(Vec3(0.02, 0.01, 0.02))).regions_entered;
  EXPECT_GT(entered, 0);
  EXPECT_NE(near->bodies()[0].regions->present, before);
  const Body &n = near->bodies()[0], &w = whole->bodies()[0];
  double largest = 0, off = 0;
  int compared = 0;
  for (int i = 0; i < n.model.node_count(); ++i) {
    if (n.model.fixed[i] || n.state.live_tets_of_node[i] == 0) continue;
    ++compared;
    largest = std::max(largest, (w.state.x[i] - w.rest()[i]).norm());
    off = std::max(off, (n.state.x[i] - w.state.x[i]).norm());
  }
  EXPECT_GT(compared, 100);
  EXPECT_GT(largest, 1e-5);
  EXPECT_LT(off, 1e-3 * largest);  // at rest but for what 400 steps left
}

// Random strokes that take tissue away, regions entered as they come: nothing bursts, what went stays gone,
// and no region brings it back.
TEST(RegionStage, CarvedAtRandom) {
  for (const unsigned seed : {1u, 2u}) {
    WorldSettings settings = pressed(ComplianceMethod::zone);
    settings.removal[0] = {200, 3e-4, 1e-3, 40};
    World world({block(true)}, ball(2e-3), settings);
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> x(0.006, 0.024), y(0.004, 0.016), z(0.008, 0.0135);
    Vec3 from(0.008, 0.01, 0.014), to = from;
    int entered = 0;
    std::set<int> gone;
    const Body& body = world.bodies()[0];
    for (int k = 0; k < 160; ++k) {
      if (k % 12 == 0) {
        from = to;
        to = Vec3(x(random), y(random), z(random));
      }
      InstrumentSample tip = at(from + (k % 12) / 12.0 * (to - from));
      tip.phaco = tip.aspiration = true;
      const StepReport report = step(world, tip);
      entered += report.regions_entered;
      ASSERT_TRUE(report.contact.wrench[0].allFinite()) << seed << ' ' << k;
      ASSERT_LT(fastest_node(body), 2) << seed << ' ' << k;
      const auto& all = body.regions->gone;
      gone.insert(all.begin(), all.end());
      ASSERT_EQ(gone.size(), all.size());
      for (const int t : all) ASSERT_FALSE(is_there(body.model, body.state, t)) << seed << ' ' << k;
      for (int t = 0; t < body.model.tet_count(); ++t)
        ASSERT_EQ(is_there(body.model, body.state, t), gone.count(t) == 0) << seed << ' ' << k;
    }
    EXPECT_GT(entered, 10) << seed;
    EXPECT_GT(gone.size(), 100u) << seed;
    for (int k = 0; k < 100; ++k) step(world, nobody());
    EXPECT_LT(fastest_node(body), 1e-3) << seed;
  }
}

// No thread makes anything: the tip leaves the only region that there is, and meets tissue that is rigid.
TEST(RegionStage, WithoutOthersTheBodyStaysInItsRegion) {
  World world({block(true)}, ball(2e-3), pressed(ComplianceMethod::zone));
  int entered = 0, rigid = 0;
  for (int k = 0; k < 60; ++k) {
    const StepReport report = step(world, travelling(k, 8e-4), false);
    entered += report.regions_entered;
    rigid += report.condensed_nodes > 0;
    ASSERT_TRUE(report.contact.wrench[0].allFinite());
  }
  EXPECT_EQ(entered, 0);
  EXPECT_GT(rigid, 5);
}

// Entered at rest, touched by nothing: no node moves.
TEST(RegionStage, NoEnergyComesOfEntering) {
  World world({block(true)}, ball(2e-3), pressed(ComplianceMethod::zone));
  for (int k = 0; k < 40; ++k) {
    step(world, at(Vec3(0.007 + 4e-4 * k, 0.01, 0.02)));
    ASSERT_LT(fastest_node(world.bodies()[0]), 1e-9) << k;
  }
  EXPECT_GT(world.bodies()[0].regions->regions->place(world.bodies()[0].regions->present).x(), 0.018);
}

TEST(RegionStage, ABodyBeginsAgainWholeWithWhatWasCondensed) {
  WorldSettings settings = pressed(ComplianceMethod::zone);
  settings.removal[0] = {200, 3e-4, 1e-3, 40};
  World world({block(true)}, ball(2e-3), settings);
  for (int k = 0; k < 60; ++k) {
    InstrumentSample tip = travelling(k, 8e-4);
    tip.phaco = k > 30;
    step(world, tip);
  }
  const Body& body = world.bodies()[0];
  ASSERT_GT(body.regions->gone.size(), 0u);
  BodySettings again = block(true);
  again.start = first_start_of(body);
  World second({again}, ball(2e-3), settings), fresh({block(true)}, ball(2e-3), settings);
  int kept = 0;
  for (const BodyRegions::Far& far : second.bodies()[0].regions->far) kept += far.tissue != nullptr;
  EXPECT_GT(kept, 3);
  for (int k = 0; k < 40; ++k) {
    InstrumentSample tip = travelling(k, 8e-4);
    tip.phaco = k > 20;
    const StepReport a = step(second, tip), b = step(fresh, tip);
    EXPECT_EQ(a.removed, b.removed) << k;
    EXPECT_NEAR((a.contact.wrench[0] - b.contact.wrench[0]).norm(), 0,
                0.02 * (1e-3 + b.contact.wrench[0].norm()))
        << k;
  }
}

}  // namespace
}  // namespace hapticd
