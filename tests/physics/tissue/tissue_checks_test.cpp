// The quick part of `haptic chart tissue`: every check of every group holds.
#include <gtest/gtest.h>

#include <cstdio>

#include "tools/chart/tissue/tissue_check.h"

namespace hapticd {
namespace {

class TissueChecks : public testing::TestWithParam<TissueCheckGroup> {};

TEST_P(TissueChecks, AgreeWithTheirReferences) {
  TissueFindings findings;
  GetParam().run(Effort::quick, findings);
  for (const TissueCheck& c : findings.checks) {
    std::printf("  %-75s %12.6g %12.6g  %.1e\n", c.name.c_str(), c.reference, c.value, c.relative_error);
    EXPECT_TRUE(c.passed) << c.name << ": " << c.value << " against " << c.reference << " (" << c.source
                          << ')';
  }
  for (const TissueSeries& s : findings.series)
    for (std::size_t i = 0; i < s.size.size(); ++i)
      std::printf("    %-60s %9.3g %9.3g\n", s.name.c_str(), s.size[i], s.error[i]);
  if (findings.checks.empty() && !findings.skipped.empty()) GTEST_SKIP() << findings.skipped.front();
}

INSTANTIATE_TEST_SUITE_P(Quick, TissueChecks, testing::ValuesIn(tissue_check_groups()),
                         [](const auto& group) { return group.param.name; });

}  // namespace
}  // namespace hapticd
