#include "server/os/crash_report.h"

#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>
#include <thread>

#include "server/os/realtime.h"

namespace hapticd {
namespace {

TEST(CrashReportDeathTest, SaysWhichThreadAndEndsByTheSignal) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto crash = [](int number) {
    report_crashes();
    std::thread([number] {
      name_thread("felt");
      std::raise(number);
    }).join();
    std::_Exit(0);
  };
  for (const int number : {SIGSEGV, SIGBUS, SIGABRT})
    EXPECT_EXIT(
        crash(number), testing::KilledBySignal(number),
        "crashed: signal " + std::to_string(number) + " in thread 'felt', called from:\n.*test_server");
}

}  // namespace
}  // namespace hapticd
