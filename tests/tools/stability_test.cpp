#include "tools/stability.h"

#include <gtest/gtest.h>

#include "server/paths.h"
#include "server/scene_reader.h"

namespace hapticd {
namespace {

// The quick atlas: in every mode the naive method breaks within the range, and the daemon does what is asked.
TEST(Stability, QuickAtlas) {
  StabilitySettings settings;
  settings.quick = true;
  const StabilityChart chart = chart_stability(read_scene(config_directory() / "scenes/cube/cube.yaml"),
                                               settings, [](double, const std::string&) { return true; });
  ASSERT_EQ(chart.modes.size() + 1, stability_mode_names().size());  // `random` has a report of its own
  for (const StabilityMode& m : chart.modes) {
    EXPECT_GT(m.naive_breaks_at, 0) << m.mode;
    EXPECT_TRUE(m.survives) << m.mode << ": broke at " << m.default_breaks_at;
  }
  ASSERT_EQ(chart.random.size(), 2u);
  for (const RandomReport& r : chart.random) {
    EXPECT_GE(r.ticks, 500);
    EXPECT_EQ(r.not_finite, 0);
    EXPECT_EQ(r.above_maximum, 0);
  }
}

}  // namespace
}  // namespace hapticd
