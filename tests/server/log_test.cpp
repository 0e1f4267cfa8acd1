#include "server/log.h"

#include <thread>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

constexpr std::int64_t moment = 1'767'225'600'123'000'000;  // 2026-01-01T00:00:00.123Z

TEST(Log, APersonGetsTheMessageAlone) {
  EXPECT_EQ(log_line(LogFormat::human, LogLevel::info, moment, "ready", "ready, domain 7", {{"domain", 7}}),
            "hapticd: ready, domain 7");
}

TEST(Log, AProgramGetsOneObjectALine) {
  EXPECT_EQ(
      log_line(LogFormat::json, LogLevel::warning, moment, "ready", "ready, \"domain\" 7", {{"domain", 7}}),
      R"({"time":"2026-01-01T00:00:00.123Z","level":"warning","event":"ready",)"
      R"("message":"ready, \"domain\" 7","domain":7})");
}

TEST(Log, WhatIsNoUtf8OrHasLineEndsStaysOneLineOfJson) {
  const std::string line =
      log_line(LogFormat::json, LogLevel::error, moment, "input", "a\nb\xff.yaml", LogFields::object());
  EXPECT_EQ(line.find('\n'), std::string::npos);
  EXPECT_TRUE(LogFields::accept(line));
}

TEST(Log, LevelsHaveNames) {
  for (LogLevel level : {LogLevel::debug, LogLevel::info, LogLevel::warning, LogLevel::error})
    EXPECT_EQ(log_level(to_string(level)), level);
  EXPECT_EQ(log_level("loud"), std::nullopt);
}

TEST(Log, ARealTimeThreadsLineIsDroppedAndCounted) {
  const std::uint64_t before = lines_refused();
  testing::internal::CaptureStderr();
  std::thread([] {
    no_log_from_this_thread();
    log(LogLevel::error, "never", "never");
  }).join();
  log(LogLevel::error, "said", "said");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "hapticd: said\n");
  EXPECT_EQ(lines_refused(), before + 1);
}

}  // namespace
}  // namespace hapticd
