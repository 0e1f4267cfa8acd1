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

// The tension across the face ahead of a crack tells it only where the mesh resolves the arms: too strong by
// less and less.
TEST(TearingBeam, BreaksNearTheLoadOfBeamTheoryOnAFineMesh) {
  double before = HUGE_VAL;
  for (const TearingBeam& b : chart_tearing_beam({4, 6, 8}, TearRule::face)) {
    ASSERT_GT(b.torn, 2);
    EXPECT_LT(b.load_n / b.theory_n, before) << b.nodes;
    EXPECT_GT(b.load_n / b.theory_n, 0.9) << b.nodes;
    before = b.load_n / b.theory_n;
  }
  EXPECT_LT(before, 1.2);
}

}  // namespace
}  // namespace hapticd
