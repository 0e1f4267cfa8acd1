// Triple-buffer channel from one writer thread to one reader thread: the reader takes the newest value.
//
// Thread safety: exactly one writer and one reader, each its own thread. They share one atomic byte.
// Invariants:
//  1. {back, middle, front} is always a permutation of {0, 1, 2}. `back` belongs to the writer and `front` to
//     the reader; `middle` is the index that the atomic holds.
//  2. The atomic holds the middle index and a "new" bit, set by publish, cleared by acquire.
//  3. publish: exchange(back | new, acq_rel). The reader that takes it sees all writes before it.
//  4. A reader never goes back: a taken slot is the newest published before the take.
//  5. A slot's value is exchanged by who has the slot alone: `acquire` with a value of the reader's own.
// Guarantee: publish and acquire are wait-free (one atomic exchange each), no allocation.
// T is written in place; the channel never copies nor moves it.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>

namespace hapticd {

template <typename T>
class Channel {
 public:
  Channel() : slot_{std::make_unique<T>(), std::make_unique<T>(), std::make_unique<T>()} {}
  Channel(const Channel&) = delete;
  Channel& operator=(const Channel&) = delete;

  // Writer: the slot to fill in, then publish. The slot's old content is an earlier publication.
  T& back() noexcept { return *slot_[back_]; }
  void publish() noexcept {
    const auto full = static_cast<std::uint8_t>(back_ | new_bit);
    back_ = middle_.exchange(full, std::memory_order_acq_rel) & index_mask;
  }

  // Reader: takes the newest if there is one (true), and looks at it.
  bool acquire() noexcept {
    if (!(middle_.load(std::memory_order_relaxed) & new_bit)) return false;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & index_mask;
    return true;
  }
  // The same, but the one looked at until now stays the reader's: it changes places with `spare`, which the
  // writer gets to fill instead.
  bool acquire(std::unique_ptr<T>& spare) noexcept {
    if (!(middle_.load(std::memory_order_relaxed) & new_bit)) return false;
    slot_[front_].swap(spare);
    return acquire();
  }
  const T& front() const noexcept { return *slot_[front_]; }

 private:
  static constexpr std::uint8_t new_bit = 4, index_mask = 3;
  static_assert(std::atomic<std::uint8_t>::is_always_lock_free);

  std::array<std::unique_ptr<T>, 3> slot_;
  std::uint8_t back_ = 0;  // writer's
  alignas(64) std::atomic<std::uint8_t> middle_{1};
  alignas(64) std::uint8_t front_ = 2;  // reader's
};

}  // namespace hapticd
