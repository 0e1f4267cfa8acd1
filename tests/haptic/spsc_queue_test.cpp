#include "haptic/spsc_queue.h"

#include <atomic>
#include <cstdint>
#include <thread>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

TEST(SpscQueue, WhatDoesNotFitIsDroppedAndCounted) {
  SpscQueue<int> queue(5);
  ASSERT_EQ(queue.capacity(), 8u);
  for (int i = 0; i < 11; ++i) EXPECT_EQ(queue.push(i), i < 8);
  EXPECT_EQ(queue.dropped(), 3u);
  int value = -1;
  for (int i = 0; i < 8; ++i) {
    ASSERT_TRUE(queue.pop(value));
    EXPECT_EQ(value, i);
  }
  EXPECT_FALSE(queue.pop(value));
  EXPECT_TRUE(queue.push(42));
  EXPECT_TRUE(queue.pop(value));
  EXPECT_EQ(value, 42);
}

TEST(SpscQueue, AcrossThreadsInOrderAndEveryOneIsReceivedOrCounted) {
  struct Item {
    std::uint64_t number, copy;
  };
  constexpr std::uint64_t least_pushes = 500'000, least_received = 5'000;
  SpscQueue<Item> queue(64);
  std::atomic<bool> done{false};
  std::atomic<std::uint64_t> received{0};
  std::uint64_t last = 0, wrong = 0;
  std::thread consumer([&] {
    Item item;
    for (;;) {
      const bool finished = done.load(std::memory_order_acquire);
      bool any = false;
      while (queue.pop(item)) {
        wrong += item.number != ~item.copy || item.number <= last;
        last = item.number;
        received.store(received.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
        any = true;
      }
      if (finished && !any) return;
      if (!any) std::this_thread::yield();
    }
  });
  std::uint64_t pushes = 0;  // however seldom the machine lets the consumer run, it is to have received some
  while (pushes < least_pushes || received.load(std::memory_order_relaxed) < least_received) {
    ++pushes;
    if (!queue.push({pushes, ~pushes})) std::this_thread::yield();
  }
  done.store(true, std::memory_order_release);
  consumer.join();
  EXPECT_EQ(wrong, 0u);
  EXPECT_EQ(received + queue.dropped(), pushes);
}

}  // namespace
}  // namespace hapticd
