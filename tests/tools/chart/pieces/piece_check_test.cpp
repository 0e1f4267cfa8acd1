// Bodies in contact against what one can write down, as the chart does it quickly. Incline and wedge with
// more angles: friction_test.cpp.
#include "tools/chart/pieces/piece_check.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace hapticd {
namespace {

TEST(PieceCheck, EveryQuickOneIsMet) {
  TissueFindings findings;
  for (const PieceCheckGroup& group : piece_check_groups()) group.run(Effort::quick, findings);
  EXPECT_GT(findings.checks.size(), 15u);
  EXPECT_TRUE(findings.skipped.empty());
  for (const TissueCheck& c : findings.checks) {
    std::printf("  %-100s %.3g, expected %.3g\n", c.name.c_str(), c.value, c.reference);
    EXPECT_TRUE(c.passed) << c.name << ": " << c.value << " against " << c.reference;
  }
}

}  // namespace
}  // namespace hapticd
