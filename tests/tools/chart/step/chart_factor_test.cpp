// On the lens of the published size our own factor is as good as CHOLMOD's; how fast is for the chart.
#include "tools/chart/step/chart_factor.h"

#include <gtest/gtest.h>

#include "tools/chart/chart.h"

namespace hapticd {
namespace {

TEST(ChartFactor, TheLensIsFactoredAsWellAsByCholmod) {
  for (const int zone : {0, 60}) {
    const FactorFigures figures = chart_factor(read_lens("1k"), zone, 3);
    EXPECT_EQ(figures.nodes, 1117);
    EXPECT_EQ(figures.zone_nodes, zone);
    EXPECT_LT(figures.own_residual, 10 * figures.cholmod_residual);
    EXPECT_LT(figures.own_residual, 1e-11);
    EXPECT_GT(figures.own_ms, 0);
    EXPECT_GT(figures.cholmod_ms, 0);
  }
}

}  // namespace
}  // namespace hapticd
