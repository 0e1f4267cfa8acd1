// Strokes of 2 mm with removals: what `haptic chart tissue --only strokes` runs for 10 000 steps, for a few.
#include "tools/offline/stroke_trial.h"

#include <gtest/gtest.h>

namespace hapticd {
namespace {

// Where contact is kept, a millisecond changes the force by no more than the onset of its viscosity does.
void expect_no_burst(const char* mesh, Law law, int steps, int removed) {
  StrokeSettings settings;
  settings.mesh = mesh;
  settings.law = law;
  settings.steps = steps;
  const StrokeReport r = run_strokes(settings, false, [](double) { return true; });
  EXPECT_EQ(r.steps, steps);
  EXPECT_GE(r.removed, removed);
  EXPECT_EQ(r.not_finite + r.refused + r.solver_caps, 0);
  EXPECT_GT(r.peak, 4e-3);
  EXPECT_LT(r.largest_change, 0.15 * r.peak);
  EXPECT_EQ(r.left_after, 0);
}

TEST(StrokesWithRemovals, HaveNoBurstsInTheLens) { expect_no_burst("lens", Law::corotational, 104, 10); }

TEST(StrokesWithRemovals, HaveNoBurstsInTheGradedLens) {
  expect_no_burst("lens_graded", Law::guarded, 52, 5);
}

}  // namespace
}  // namespace hapticd
