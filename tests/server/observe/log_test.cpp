#include "server/observe/log.h"

#include <fcntl.h>
#include <unistd.h>

#include <string>
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

// A full pipe that nobody reads: nothing waits, what is lost is counted and told once there is room.
TEST(Log, AFullPipeLosesLinesAndHoldsNobody) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const int before = dup(STDERR_FILENO);
  dup2(ends[1], STDERR_FILENO);
  const std::uint64_t lost = lines_lost();
  const std::string long_message(1000, 'x');
  for (int i = 0; i < 200; ++i) log(LogLevel::error, "flood", long_message);  // 200 kB; a pipe takes 64
  const std::uint64_t missing = lines_lost() - lost;
  EXPECT_EQ(fcntl(ends[1], F_GETFL) & O_NONBLOCK, 0) << "the flags of others stay";
  std::string text(1 << 20, '\0');
  text.resize(static_cast<std::size_t>(read(ends[0], text.data(), text.size())));
  log(LogLevel::error, "after", "there is room again");
  std::string told(1 << 16, '\0');
  told.resize(static_cast<std::size_t>(read(ends[0], told.data(), told.size())));
  dup2(before, STDERR_FILENO);
  close(before);
  close(ends[0]);
  close(ends[1]);
  EXPECT_GT(missing, 100u);
  EXPECT_NE(told.find("hapticd: there is room again\nhapticd: " + std::to_string(missing) +
                      " lines were lost: nobody read them\n"),
            std::string::npos)
      << told;
}

}  // namespace
}  // namespace hapticd
