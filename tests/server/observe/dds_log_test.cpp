// Cyclone's words on their way to the log.
#include "server/observe/dds_log.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

namespace hapticd {
namespace {

constexpr std::int64_t second = 1'000'000'000;

std::vector<std::string> written(std::int64_t now_ns) {
  testing::internal::CaptureStderr();
  write_dds_log(now_ns);
  std::istringstream text(testing::internal::GetCapturedStderr());
  std::vector<std::string> out;
  for (std::string line; std::getline(text, line);) out.push_back(line);
  return out;
}

// Ten of a hundred, and ten seconds later how many there were besides.
TEST(DdsLog, AFloodIsAFewLinesAndANumber) {
  written(1000 * second);
  for (int i = 0; i < 100; ++i) note_dds_line(LogLevel::warning, 7, "malformed " + std::to_string(i));
  std::vector<std::string> lines = written(1001 * second);
  ASSERT_EQ(lines.size(), 10u);
  EXPECT_EQ(lines.front(), "hapticd: DDS: malformed 0");
  EXPECT_TRUE(written(1009 * second).empty());
  lines = written(1011 * second);
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_EQ(lines.front(), "hapticd: DDS: 90 more lines were left out");
}

// Nobody reads for a while: what does not fit is counted, and nobody waited.
TEST(DdsLog, AFullQueueLosesAndCounts) {
  written(2000 * second);
  const std::uint64_t before = dds_lines();
  for (int i = 0; i < 10'000; ++i) note_dds_line(LogLevel::warning, 7, "x");
  EXPECT_EQ(dds_lines(), before + 10'000);
  EXPECT_EQ(written(2001 * second).size(), 10u);
  const std::vector<std::string> lines = written(2012 * second);
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_EQ(lines.front(), "hapticd: DDS: 9990 more lines were left out");
}

// Four writers and a reader: every line is written, left out, or dropped, none twice.
TEST(DdsLog, WritersOfManyThreadsLoseNothingUncounted) {
  written(3000 * second);
  std::vector<std::thread> writers;
  std::atomic<int> running{4};
  for (int w = 0; w < 4; ++w)
    writers.emplace_back([&] {
      for (int i = 0; i < 20'000; ++i) note_dds_line(LogLevel::warning, 7, "of many");
      --running;
    });
  std::uint64_t count = 0;
  std::int64_t now = 3001 * second;
  const auto look = [&] {
    for (const std::string& line : written(now)) {
      const std::string left_out = "more lines were left out";
      if (line.find(left_out) == std::string::npos)
        ++count;
      else
        count += std::stoull(line.substr(std::string("hapticd: DDS: ").size()));
    }
    now += 11 * second;
  };
  while (running > 0) look();
  for (std::thread& w : writers) w.join();
  for (int i = 0; i < 3; ++i) look();
  EXPECT_EQ(count, 80'000u);
}

}  // namespace
}  // namespace hapticd
