// `haptic view` as a process, in a real browser: page_test.py has the steps. Skipped where there is no
// Chromium.
#include <gtest/gtest.h>

#include <unistd.h>

#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

void in_a_browser(const std::string& mode) {
  const std::string domain = std::to_string(100 + getpid() % 40);
  const CommandResult result = run_command("/usr/bin/python3 " SOURCE_DIR "/tests/tools/view/page_test.py " +
                                           mode + " " BIN_DIR " " SOURCE_DIR " " + domain);
  if (result.code == 77) GTEST_SKIP() << result.output;
  EXPECT_EQ(result.code, 0) << result.output;
}

// The published lens, cut; the daemon killed and started again.
TEST(ViewDaemon, ABrowserSeesTheLensBreakAndTheDaemonGoAndComeBack) { in_a_browser("live"); }
TEST(ViewDaemon, ARecordingPlaysToItsEndAndBack) { in_a_browser("recording"); }
TEST(ViewDaemon, AMouseIsAHandWithinItsBounds) { in_a_browser("control"); }

TEST(ViewDaemon, TwoToolsAndTwoForcesAreShown) { in_a_browser("hands"); }

TEST(View, UsageIsChecked) {
  const ScratchDirectory scratch;
  EXPECT_EQ(run_haptic("view --recording " + scratch.file("a.csv", "t,px,py,pz\n0,0,0,0\n1,0,0,0\n")).code,
            2);
  EXPECT_EQ(run_haptic("view --recording " + scratch.file("none.csv") +
                       " --scene " SOURCE_DIR "/config/scenes/cube/cube.yaml")
                .code,
            2);
  EXPECT_EQ(run_haptic("view --page " + scratch.file("none") + " --port 0 --duration 0.1").code, 2);
  EXPECT_EQ(run_haptic("view --listen here --duration 0.1").code, 2);
  EXPECT_EQ(run_haptic("view --control --recording a.csv").code, 2);
  EXPECT_EQ(run_haptic("view --port 0 --duration 0.1 --domain " + std::to_string(100 + getpid() % 40)).code,
            0);
}

}  // namespace
}  // namespace hapticd
