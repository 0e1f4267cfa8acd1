// Where the time of a piece of work goes, part by part, for whoever owns a clock.
//
//   t_part = Σ of the times in which it was the innermost part
//
// Physics has no clock: who runs it hands one in. Without one a part costs a branch. Units: ns. Thread
// safety: one thread at a time. Guarantee: wait-free, no allocation, if the clock is.
#pragma once

#include <array>
#include <cstdint>
#include <utility>

namespace hapticd {

// A simulation step. What is in no other part is of `publish`: the problem's positions, reports, snapshots.
enum class StepPart : std::uint8_t {
  publish,
  collision,    // what is near: removal, surface, zone, patch
  assembly,     // rotations and A
  factor,       // of A or of the zone's corner, with its order
  free_motion,  // forces and solves
  condense,     // C_pp
  solve,        // contact
  count
};
inline constexpr std::size_t step_parts = static_cast<std::size_t>(StepPart::count);

// A contact solve.
enum class ContactPart : std::uint8_t {
  rest,  // warm start, displacement, memory
  rows,
  delassus,  // W
  solve,
  count
};

class PartTimes {
 public:
  using Clock = std::int64_t (*)() noexcept;

  explicit PartTimes(Clock clock) noexcept : clock_(clock), since_(clock()) {}

  // From here on, in part 0; what was counted so far is forgotten.
  void start() noexcept {
    ns_.fill(0);
    part_ = 0;
    since_ = clock_();
  }

  // Returns the part so far.
  int enter(int part) noexcept {
    const std::int64_t now = clock_();
    ns_[part_] += now - since_;
    since_ = now;
    return std::exchange(part_, part);
  }

  template <class Part>
  std::int64_t ns(Part part) const noexcept {
    return ns_[static_cast<std::size_t>(part)];
  }

 private:
  Clock clock_;
  std::int64_t since_;
  int part_ = 0;
  std::array<std::int64_t, 8> ns_{};
};

// While it lives, time is this part's. `times` may be null.
class Within {
 public:
  template <class Part>
  Within(PartTimes* times, Part part) noexcept
      : times_(times), outer_(times ? times->enter(static_cast<int>(part)) : 0) {}
  ~Within() {
    if (times_) times_->enter(outer_);
  }
  Within(const Within&) = delete;
  Within& operator=(const Within&) = delete;

 private:
  PartTimes* times_;
  int outer_;
};

}  // namespace hapticd
