// The accounting of a 1 kHz client: which slots were scheduled, sent and answered.
//
//   slot k is scheduled at t0 + k·period, k = 0 … scheduled − 1, the whole duration, whatever happens
//   sent:     a state numbered first_number + k left the client
//   answered: a force whose echo_number is first_number + k arrived
// A client that wakes too late for a slot skips it: the slot counts as scheduled and not as sent. Times
// count from the intended instant as well as from the sending, so that a late client cannot flatter its
// figures (no coordinated omission).
//
// Thread safety: `send` belongs to one thread, `answer` to another; they touch different arrays. The
// remaining functions are for when both have ended, except `sent` and `answered`, which any thread may read.
// Guarantee: send and answer are noexcept, wait-free and do not allocate.
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

namespace hapticd {

struct SlotPlan {
  std::int64_t t0_ns = 0;
  std::int64_t period_ns = 1'000'000;
  std::int64_t slots = 0;
  std::uint64_t first_number = 1;

  std::int64_t time_of(std::int64_t k) const noexcept { return t0_ns + k * period_ns; }
  std::uint64_t number_of(std::int64_t k) const noexcept {
    return first_number + static_cast<std::uint64_t>(k);
  }

  // The slot to serve by a client awake at `now` that has served all before `next`: `next`, or the slot whose
  // period `now` lies in when `next` is already over; `slots` when nothing remains.
  std::int64_t slot_to_serve(std::int64_t next, std::int64_t now_ns) const noexcept;
};

class SlotBook {
 public:
  // With everything reserved for `slots`; `begin` sets the rest of the plan, before the first send.
  explicit SlotBook(std::int64_t slots);
  void begin(std::int64_t t0_ns, std::uint64_t first_number) noexcept;

  const SlotPlan& plan() const noexcept { return plan_; }

  void send(std::int64_t k, std::int64_t now_ns) noexcept;

  // The slot of an echoed number, or −1 if it is none of this plan's.
  std::int64_t slot_of(std::uint64_t number) const noexcept;
  // True at the first answer to a slot; later ones are counted as repeats.
  bool answer(std::int64_t k, std::int64_t now_ns) noexcept;

  std::int64_t scheduled() const noexcept { return plan_.slots; }
  std::int64_t sent() const noexcept { return sent_.load(std::memory_order_relaxed); }
  std::int64_t answered() const noexcept { return answered_.load(std::memory_order_relaxed); }
  std::int64_t repeats() const noexcept { return repeats_.load(std::memory_order_relaxed); }

  // 0 where it did not happen.
  std::int64_t sent_ns(std::int64_t k) const noexcept { return sent_at_[index(k)]; }
  std::int64_t answered_ns(std::int64_t k) const noexcept { return answered_at_[index(k)]; }

  // Over the slots where it is defined [µs].
  std::vector<double> round_trip_us() const;           // answered − sent
  std::vector<double> intended_round_trip_us() const;  // answered − scheduled
  std::vector<double> lateness_us() const;             // sent − scheduled

 private:
  static std::size_t index(std::int64_t k) noexcept { return static_cast<std::size_t>(k); }

  SlotPlan plan_;
  std::vector<std::int64_t> sent_at_, answered_at_;
  std::atomic<std::int64_t> sent_{0}, answered_{0}, repeats_{0};
};

}  // namespace hapticd
