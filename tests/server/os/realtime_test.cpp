#include "server/os/realtime.h"

#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

#include <memory>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

int policy_of_caller() {
  int policy = -1;
  sched_param param{};
  pthread_getschedparam(pthread_self(), &policy, &param);
  return policy;
}

int cores_of_caller() {
  cpu_set_t set;
  CPU_ZERO(&set);
  pthread_getaffinity_np(pthread_self(), sizeof set, &set);
  return CPU_COUNT(&set);
}

TEST(Realtime, GrantSaysWhatTheThreadThenHas) {
  const int before = policy_of_caller();
  bool granted = false;
  int policy = -1;
  std::string detail;
  std::thread([&] {
    const Grant grant = use_fifo(haptic_priority);
    granted = grant.granted;
    detail = grant.detail;
    policy = policy_of_caller();
  }).join();
  EXPECT_EQ(granted, policy == SCHED_FIFO);
  EXPECT_EQ(granted, detail.empty());
  EXPECT_EQ(granted, realtime_allowed());
  EXPECT_EQ(policy_of_caller(), before);  // neither call touches its caller
}

TEST(Realtime, CoreThatDoesNotExistIsRefusedWithItsReason) {
  for (const int core : {-1, 100'000}) {
    const Grant grant = use_core(core);
    EXPECT_FALSE(grant.granted);
    EXPECT_EQ(grant.what, "core " + std::to_string(core));
    EXPECT_FALSE(grant.detail.empty());
  }
}

// As the daemon's threads do, behind keep_malloc_pages; an arena of its own, since the thread is new.
TEST(Realtime, WhatAThreadAsksForLaterComesFromPagesThatAreThere) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer has a malloc of its own";
#endif
  keep_malloc_pages();
  const auto faults = [] {
    rusage usage{};
    getrusage(RUSAGE_THREAD, &usage);
    return usage.ru_minflt + usage.ru_majflt;
  };
  std::thread([&] {
    prefault_heap(4 << 20);
    const long before = faults();
    std::vector<std::unique_ptr<char[]>> blocks;
    blocks.reserve(30);
    for (int i = 0; i < 30; ++i) {
      blocks.push_back(std::make_unique<char[]>(100'000));  // written: zeros
    }
    EXPECT_LE(faults() - before, 5);
  }).join();
}

TEST(Realtime, WhoStandsBackIsNeverOnTheLastCoreAndNobodyElseIsMoved) {
  const int before = cores_of_caller();
  std::thread([] {
    const std::vector<int> mine = process_cores();
    stand_back();
    std::vector<int> now;
    std::thread([&] { now = process_cores(); }).join();  // inherited
    EXPECT_EQ(getpriority(PRIO_PROCESS, static_cast<id_t>(gettid())), 10);
    if (mine.size() < 2) return;
    EXPECT_EQ(now, std::vector<int>(mine.begin(), mine.end() - 1));
  }).join();
  EXPECT_EQ(cores_of_caller(), before);
  EXPECT_EQ(getpriority(PRIO_PROCESS, static_cast<id_t>(gettid())), 0);
}

TEST(Realtime, ScopedCoreIsInheritedWhileItLivesAndGivenBack) {
  const int before = cores_of_caller();
  const int here = sched_getcpu();
  {
    const ScopedCore scoped(here);
    ASSERT_TRUE(scoped.grant().granted);
    int inherited = 0, core = -1;
    std::thread([&] {
      inherited = cores_of_caller();
      core = sched_getcpu();
    }).join();
    EXPECT_EQ(inherited, 1);
    EXPECT_EQ(core, here);
  }
  EXPECT_EQ(cores_of_caller(), before);
}

TEST(Realtime, RefusedLatencyRequestLeavesAWorkingProcess) {
  const CpuLatency latency;
  EXPECT_EQ(latency.grant().granted, latency.grant().detail.empty());
  prefault_stack();
  EXPECT_TRUE(keep_malloc_pages().granted);
}

}  // namespace
}  // namespace hapticd
