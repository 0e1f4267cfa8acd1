#include "tools/cli/report.h"

#include <gtest/gtest.h>

#include <fstream>
#include <numeric>

#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

TEST(Report, QuantilesAreByNearestRank) {
  std::vector<double> values(1000);
  std::iota(values.rbegin(), values.rend(), 1.0);  // 1000 … 1
  const Quantiles q = quantiles(values);
  EXPECT_EQ(q.p50, 500);
  EXPECT_EQ(q.p99, 990);
  EXPECT_EQ(q.p99_9, 999);
  EXPECT_EQ(q.max, 1000);
  EXPECT_EQ(quantiles({7}).p99_9, 7);
  EXPECT_TRUE(to_json(quantiles({}))["p50"].is_null());
}

TEST(Report, AFileIsWrittenWholeOrTheErrorNamesIt) {
  const ScratchDirectory scratch;
  write_json(scratch.file("a.json"), {{"x", 1}});
  EXPECT_EQ(nlohmann::json::parse(std::ifstream(scratch.file("a.json")))["x"], 1);
  try {
    write_file(scratch.file("a.json") + "/b", "x");  // a file is no folder
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("a.json"), std::string::npos);
  }
}

}  // namespace
}  // namespace hapticd
