#include "tools/chart/cut/tearing_beam.h"

#include <cmath>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

// The finer the arms, the nearer to beam theory; with six elements over an arm within a tenth.
TEST(TearingBeam, TearsAtTheLoadOfBeamTheory) {
  const std::vector<TearingBeam> beams = chart_tearing_beam({2, 4, 6});
  double before = 1;
  for (const TearingBeam& b : beams) {
    ASSERT_GT(b.torn, 2);
    const double error = std::abs(b.load_n / b.theory_n - 1);
    EXPECT_LT(error, before) << b.nodes;
    before = error;
  }
  EXPECT_LT(before, 0.1);
}

// What opening the next faces releases tells it, too: within a tenth from four elements over an arm on.
TEST(TearingBeam, BreaksAtTheLoadOfBeamTheory) {
  double before = 0.1;
  for (const TearingBeam& b : chart_tearing_beam({4, 6, 8}, TearRule::face)) {
    ASSERT_GT(b.torn, 2);
    const double error = std::abs(b.load_n / b.theory_n - 1);
    EXPECT_LT(error, before) << b.nodes;
    before = error;
  }
}

}  // namespace
}  // namespace hapticd
