// Bounded queue from one producer thread to one consumer thread; a value that does not fit is dropped
// and counted.
//
// Thread safety: exactly one producer and one consumer, each its own thread.
// Invariants:
//  1. head − tail is the number of values inside, 0 … capacity; both only grow.
//  2. Slot i mod capacity belongs to the consumer while i is in [tail, head), else to the producer.
//  3. push writes the slot, then releases head; pop acquires head, reads, then releases tail.
// Guarantee: push and pop are wait-free and allocate nothing as long as copying a T does not. The
// constructor reserves the memory.
#pragma once

#include <atomic>
#include <bit>
#include <cstdint>
#include <memory>

namespace hapticd {

template <typename T>
class SpscQueue {
 public:
  // The capacity is rounded up to a power of two.
  explicit SpscQueue(std::size_t capacity)
      : mask_(std::bit_ceil(capacity) - 1), slot_(std::make_unique<T[]>(mask_ + 1)) {}
  SpscQueue(const SpscQueue&) = delete;
  SpscQueue& operator=(const SpscQueue&) = delete;

  // Producer. False: full, the value was dropped.
  bool push(const T& value) noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    if (head - tail_.load(std::memory_order_acquire) > mask_) {
      dropped_.store(dropped_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
      return false;
    }
    slot_[head & mask_] = value;
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

  // Consumer. False: empty.
  bool pop(T& value) noexcept {
    const std::uint64_t tail = tail_.load(std::memory_order_relaxed);
    if (tail == head_.load(std::memory_order_acquire)) return false;
    value = slot_[tail & mask_];
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  // Any thread.
  std::uint64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }
  std::size_t capacity() const noexcept { return mask_ + 1; }

 private:
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

  std::size_t mask_;
  std::unique_ptr<T[]> slot_;
  alignas(64) std::atomic<std::uint64_t> head_{0};  // written by the producer
  std::atomic<std::uint64_t> dropped_{0};
  alignas(64) std::atomic<std::uint64_t> tail_{0};  // written by the consumer
};

}  // namespace hapticd
