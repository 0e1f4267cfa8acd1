// Too little of something is said in words, with what is needed.
#include "server/os/room.h"

#include <sys/resource.h>
#include <unistd.h>

#include <fstream>
#include <stdexcept>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

namespace fs = std::filesystem;

std::string fault(auto&& ask) {
  try {
    ask();
  } catch (const std::runtime_error& e) {
    return e.what();
  }
  return "";
}

class SoftLimit {
 public:
  SoftLimit(__rlimit_resource_t kind, rlim_t value) : kind_(kind) {
    getrlimit(kind_, &before_);
    const rlimit now{std::min(value, before_.rlim_max), before_.rlim_max};
    setrlimit(kind_, &now);
  }
  ~SoftLimit() { setrlimit(kind_, &before_); }
  SoftLimit(const SoftLimit&) = delete;
  SoftLimit& operator=(const SoftLimit&) = delete;

 private:
  __rlimit_resource_t kind_;
  rlimit before_{};
};

TEST(Room, WhatIsThereIsGivenBack) {
  EXPECT_EQ(fault([] { require_threads(4); }), "");
  EXPECT_EQ(fault([] { require_address_space(1 << 20); }), "");
  EXPECT_EQ(fault([] { require_memory(1, ""); }), "");
  for (int i = 0; i < 100; ++i) require_descriptors(20);  // with fewer than 2 000 to be had
}

TEST(Room, TooFewDescriptorsAreSaid) {
  const SoftLimit limit(RLIMIT_NOFILE, 30);
  const std::string said = fault([] { require_descriptors(200); });
  EXPECT_NE(said.find("not enough file descriptors: 200 more are needed"), std::string::npos) << said;
  EXPECT_NE(said.find("ulimit -n"), std::string::npos) << said;
}

TEST(Room, TooLittleMemoryIsSaidWithWhatHoldsIt) {
  const std::string said = fault([] { require_memory(std::int64_t{1} << 60, "; buy some"); });
  EXPECT_NE(said.find("not enough memory: 1152921504606 MB are needed"), std::string::npos) << said;
  EXPECT_NE(said.find("; buy some"), std::string::npos) << said;
}

// A /proc and a /sys of our own.
class Machine {
 public:
  Machine() : root_(fs::path(testing::TempDir()) / ("room" + std::to_string(getpid()))) {
    fs::remove_all(root_);
    file("proc/meminfo", "MemTotal: 4000000 kB\nMemAvailable:    2000000 kB\n");
  }
  ~Machine() { fs::remove_all(root_); }
  void file(const fs::path& name, const std::string& text) const {
    fs::create_directories((root_ / name).parent_path());
    std::ofstream(root_ / name) << text;
  }
  const fs::path& root() const { return root_; }

 private:
  fs::path root_;
};

TEST(Room, TheLeastOfMachineAndCgroupsCounts) {
  const Machine m;
  EXPECT_EQ(memory_left(m.root()).bytes, 2'048'000'000);
  EXPECT_EQ(memory_left(m.root()).limit, "MemAvailable");

  // Version 2: a limit of a group above holds too; what is cached of files is free.
  m.file("proc/self/cgroup", "0::/a/b\n");
  m.file("sys/fs/cgroup/a/b/memory.max", "max\n");
  m.file("sys/fs/cgroup/a/memory.max", "80000000\n");
  m.file("sys/fs/cgroup/a/memory.current", "50000000\n");
  m.file("sys/fs/cgroup/a/memory.stat", "anon 20\ninactive_file 7000000\nactive_file 3000000\n");
  EXPECT_EQ(memory_left(m.root()).bytes, 40'000'000);
  EXPECT_TRUE(memory_left(m.root()).limit.ends_with("a/memory.max"));

  // Version 1, in a container that sees its own hierarchy only.
  m.file("proc/self/cgroup", "5:memory:/docker/x\n");
  m.file("sys/fs/cgroup/memory/memory.limit_in_bytes", "60000000\n");
  m.file("sys/fs/cgroup/memory/memory.usage_in_bytes", "10000000\n");
  EXPECT_EQ(memory_left(m.root()).bytes, 50'000'000);
  m.file("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
  EXPECT_EQ(memory_left(m.root()).limit, "MemAvailable");
}

}  // namespace
}  // namespace hapticd
