// Starting and stopping, again and again, leaves nothing behind: no heap, no file, no thread.
//
// HAPTICD_CYCLES says how often (`slow` tests: 1000). Memory is what the allocator has given out, so that
// what it merely keeps for the next time does not count.
#include <malloc.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <thread>

#include <gtest/gtest.h>

#include "server/app/daemon.h"
#include "server/scene/scene_reader.h"
#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

int cycles() {
  const char* set = std::getenv("HAPTICD_CYCLES");
  return set ? std::atoi(set) : 20;
}

struct Held {
  double heap_kb;
  std::ptrdiff_t files, threads;
};

Held held() {
  const struct mallinfo2 m = mallinfo2();
  const auto count = [](const char* folder) {
    return std::distance(std::filesystem::directory_iterator(folder), std::filesystem::directory_iterator());
  };
  return {1e-3 * static_cast<double>(m.uordblks + m.hblkhd), count("/proc/self/fd"),
          count("/proc/self/task")};
}

void expect_nothing_left(const Held& before, const Held& after, int times, double kb_each) {
  std::printf("  %d cycles: heap %+.1f kB, files %+td, threads %+td\n", times, after.heap_kb - before.heap_kb,
              after.files - before.files, after.threads - before.threads);
  EXPECT_LT(after.heap_kb - before.heap_kb, 64 + kb_each * times);
  EXPECT_EQ(after.files, before.files);
  EXPECT_EQ(after.threads, before.threads);
}

// The whole daemon but its process: DDS domain, world, both loops, diagnostics, a recording every tenth time.
TEST(CyclesDaemon, StartedAndStoppedInOneProcessItLeavesNothing) {
  const ScratchDirectory scratch;
  const Scene scene = read_scene(SOURCE_DIR "/config/scenes/cube/cube.yaml");
  const auto cycle = [&](int i) {
    DaemonOptions options;
    options.domain = static_cast<std::uint32_t>(40 + getpid() % 60);
    if (i % 10 == 0) options.record = scratch.file("bag" + std::to_string(i));
    Daemon daemon(scene, options);
    daemon.start();
    std::this_thread::sleep_for(std::chrono::milliseconds(25));
    daemon.stop();
    EXPECT_FALSE(daemon.failed()) << daemon.failure();
    if (options.record) std::filesystem::remove_all(*options.record);
  };
  for (int i = 0; i < 5; ++i) cycle(i);  // what is made once
  const Held before = held();
  for (int i = 0; i < cycles(); ++i) cycle(i);
  // Cyclone itself keeps a little of each domain.
  expect_nothing_left(before, held(), cycles(), 0.5);
}

// As a process: each ends with 0, whatever it was doing when told to.
TEST(CyclesDaemon, StartedAndStoppedAsAProcessItEndsWell) {
  const int times = std::max(3, cycles() / 5);
  for (int i = 0; i < times; ++i) {
    const CommandResult r =
        run_command(BIN_DIR "/hapticd " SOURCE_DIR "/config/scenes/cube/cube.yaml --duration 0.05 --domain " +
                    std::to_string(40 + getpid() % 60));
    ASSERT_EQ(r.code, 0) << i << ": " << r.output;
  }
  std::printf("  %d processes\n", times);
}

}  // namespace
}  // namespace hapticd
