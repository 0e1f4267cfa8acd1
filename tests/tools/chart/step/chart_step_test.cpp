// The chart's bookkeeping; how fast a step is, is for the chart itself.
#include "tools/chart/step/chart_step.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "tools/chart/step/chart_tick.h"

namespace hapticd {
namespace {

TEST(ChartStep, PartsAddUpToTheStep) {
  for (const ComplianceMethod method : {ComplianceMethod::exact, ComplianceMethod::zone}) {
    StepCase of;
    of.lens = step_lenses().front();
    of.method = method;
    of.steps = 30;
    of.removals_per_s = method == ComplianceMethod::zone ? 10 : 0;
    double shown = 0;
    const StepPoint p = chart_step(of, [&](double fraction) {
      EXPECT_GE(fraction, shown);
      shown = fraction;
      return true;
    });
    SCOPED_TRACE(p.compliance);
    EXPECT_EQ(p.nodes, 1117);
    EXPECT_GT(p.contacts, 0);
    EXPECT_GT(p.patch_nodes, 20);
    EXPECT_GT(p.steps, 30);
    EXPECT_EQ(p.removed > 0, of.removals_per_s > 0);
    EXPECT_EQ(p.bases > 0, method == ComplianceMethod::zone);
    EXPECT_NEAR(std::accumulate(p.parts_ms.begin(), p.parts_ms.end(), 0.0), p.mean_ms, 0.02 * p.mean_ms);
    for (const StepPart part : {StepPart::collision, StepPart::assembly, StepPart::factor,
                                StepPart::free_motion, StepPart::condense, StepPart::solve})
      EXPECT_GT(p.parts_ms[static_cast<std::size_t>(part)], 0) << name_of(part);
    EXPECT_LE(p.step_ms_median, p.step_ms_p99);
  }
}

TEST(ChartStep, ACubeLawHasExponentThree) {
  std::vector<StepPoint> points(3);
  for (std::size_t k = 0; k < points.size(); ++k) {
    points[k].model = "linear";
    points[k].compliance = "exact";
    points[k].nodes = 100 << k;
    points[k].step_ms_median = std::pow(points[k].nodes, 3) * 1e-6;
  }
  const auto ms = [](const StepPoint& p) { return p.step_ms_median; };
  EXPECT_NEAR(growth(points, "linear", "exact", 0, 0, ms).value(), 3, 1e-12);
  EXPECT_FALSE(growth(points, "linear", "zone", 0, 0, ms));
  EXPECT_FALSE(growth(points, "linear", "exact", 0, 0, [](const StepPoint&) { return 0.0; }));
  // Of another part of the mesh.
  points.push_back(points.back());
  points.back().near = 4;
  points.back().step_ms_median *= 2;
  EXPECT_NEAR(growth(points, "linear", "exact", 0, 0, ms).value(), 3, 1e-12);
  EXPECT_FALSE(growth(points, "linear", "exact", 4, 0, ms));
}

// `exact` has no other thread whose time would matter: what differs is the condensed tissue.
TEST(ChartStep, ACondensedLensIsFeltAsTheWhole) {
  std::vector<StepPoint> points;
  for (const double near : {0.0, 4.0}) {
    StepCase of;
    of.lens = step_lenses().front();
    of.steps = 60;
    of.near = near;
    points.push_back(chart_step(of, [](double) { return true; }));
  }
  compare_forces(points);
  EXPECT_FALSE(points[0].force_rms_rel);
  EXPECT_LT(points[1].simulated, 0.4 * points[0].simulated);
  EXPECT_GT(points[1].boundary, 20);
  EXPECT_GT(points[1].regions_entered, 0);
  EXPECT_EQ(points[1].fallback_steps, 0);
  ASSERT_TRUE(points[1].force_rms_rel);
  EXPECT_LT(*points[1].force_rms_rel, 0.01);
  EXPECT_LT(*points[1].force_max_rel, 0.03);
}

TEST(ChartStep, TheHapticTickIsInContactWithFriction) {
  TickSettings settings;
  settings.steps = 5;
  const TickFigures t = chart_tick(settings, [](double) { return true; });
  EXPECT_EQ(t.ticks, 100);
  EXPECT_GE(t.contacts, 20);
  EXPECT_GE(t.contacts, t.active);
  EXPECT_GT(t.patch_nodes, 30);
  EXPECT_NEAR(std::accumulate(t.parts_us.begin(), t.parts_us.end(), 0.0), t.us_mean, 0.05 * t.us_mean);
}

}  // namespace
}  // namespace hapticd
