// Memory on huge pages that the kernel leaves alone once it is there.
#include "physics/compliance/factor/page_memory.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
#include <sstream>
#include <string>
#include <utility>

namespace hapticd {
namespace {

// Flags of the mapping that holds the address (proc(5), smaps), empty if the kernel gives none.
std::string flags_at(const void* p) {
  const auto address = reinterpret_cast<std::uintptr_t>(p);
  std::ifstream smaps("/proc/self/smaps");
  bool here = false;
  for (std::string line; std::getline(smaps, line);) {
    std::uintptr_t begin = 0, end = 0;
    char dash = 0;
    std::istringstream head(line);
    if (head >> std::hex >> begin >> dash >> end && dash == '-') here = begin <= address && address < end;
    if (here && line.rfind("VmFlags:", 0) == 0) return line;
  }
  return {};
}

TEST(PageMemory, IsZeroAlignedAndAsLargeAsAsked) {
  PageMemory memory;
  memory.reserve(300'000);
  ASSERT_GE(memory.size(), 300'000u);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(memory.data()) % (std::size_t{2} << 20), 0u);
  for (std::size_t k = 0; k < memory.size(); ++k) ASSERT_EQ(memory.data()[k], 0) << k;
}

TEST(PageMemory, StaysWhereItIsUntilItGrows) {
  PageMemory memory;
  memory.reserve(10);
  double* const before = memory.data();
  before[0] = 1;
  memory.reserve(memory.size());
  EXPECT_EQ(memory.data(), before);
  EXPECT_EQ(before[0], 1);
  memory.reserve(memory.size() + 1);
  EXPECT_EQ(memory.data()[0], 0);
}

TEST(PageMemory, MovesWithItsContent) {
  PageMemory memory;
  memory.reserve(10);
  memory.data()[9] = 3;
  const PageMemory other = std::move(memory);
  EXPECT_EQ(other.data()[9], 3);
}

// "hg": khugepaged would come back for it, and stop whoever touches it then.
TEST(PageMemory, AsksForHugePagesOnlyAtFirst) {
  PageMemory memory;
  memory.reserve(1'000'000);
  const std::string flags = flags_at(memory.data());
  if (flags.empty()) GTEST_SKIP() << "this kernel tells no flags of mappings";
  EXPECT_EQ(flags.find(" hg"), std::string::npos) << flags;
}

}  // namespace
}  // namespace hapticd
