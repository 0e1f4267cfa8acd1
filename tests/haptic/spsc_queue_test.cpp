#include "haptic/spsc_queue.h"

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
  constexpr std::uint64_t pushes = 500'000;
  SpscQueue<Item> queue(64);
  std::atomic<bool> done{false};
  std::uint64_t received = 0, last = 0, wrong = 0;
  std::thread consumer([&] {
    Item item;
    for (;;) {
      const bool finished = done.load(std::memory_order_acquire);
      bool any = false;
      while (queue.pop(item)) {
        wrong += item.number != ~item.copy || item.number <= last;
        last = item.number;
        ++received;
        any = true;
      }
      if (finished && !any) return;
      if (!any) std::this_thread::yield();
    }
  });
  for (std::uint64_t n = 1; n <= pushes; ++n)
    if (!queue.push({n, ~n})) std::this_thread::yield();
  done.store(true, std::memory_order_release);
  consumer.join();
  EXPECT_EQ(wrong, 0u);
  EXPECT_EQ(received + queue.dropped(), pushes);
  EXPECT_GT(received, pushes / 100);
}

}  // namespace
}  // namespace hapticd
