// The fuzzers' corpora, once each and without libFuzzer: what once was found stays found.
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "server/files/paths.h"
#include "tests/fuzz/targets.h"

namespace hapticd {
namespace {

int run_each(const std::string& folder, void (*target)(FuzzInput)) {
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(SOURCE_DIR "/tests/" + folder)) {
    SCOPED_TRACE(entry.path());
    const std::string bytes = read_bytes(entry.path());
    target({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
    ++count;
  }
  return count;
}

TEST(FuzzCorpus, Mesh) {
  EXPECT_GT(run_each("fuzz/corpus/mesh", fuzz_mesh) + run_each("data", fuzz_mesh), 4);
}
TEST(FuzzCorpus, Scene) { EXPECT_GT(run_each("fuzz/corpus/scene", fuzz_scene), 2); }
TEST(FuzzCorpus, Trajectory) { EXPECT_GT(run_each("fuzz/corpus/trajectory", fuzz_trajectory), 2); }
TEST(FuzzCorpus, Bag) { EXPECT_GT(run_each("fuzz/corpus/bag", fuzz_bag), 2); }
TEST(FuzzCorpus, Rtps) { EXPECT_GT(run_each("fuzz/corpus/rtps", fuzz_rtps), 2); }
TEST(FuzzCorpus, Device) { EXPECT_GT(run_each("fuzz/corpus/device", fuzz_device), 2); }

}  // namespace
}  // namespace hapticd
