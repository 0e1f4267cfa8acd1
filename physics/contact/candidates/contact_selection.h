// Which candidates become contacts where there are more than capacity: a stated rule, never order of
// discovery.
//
//   1. half of the capacity: the smallest gaps (the deepest)
//   2. the rest, spread over the surface: the deepest sample of every face that has none yet, then the second
//      of every face, and so on; within a round by gap
//
// A flat face has three normal freedoms, so its further samples add little that a fourth contact elsewhere
// would not. Ties go to the lower sample index, then instrument, then primitive, so the choice is a function
// of the set alone. Units: m. Guarantee: wait-free, no allocation, O(n) on average and
// O(n log n) at the most; 34 kB of stack.
#pragma once

#include <cstdint>
#include <span>

namespace hapticd {

struct ContactCandidate {
  double gap;
  int sample;
  std::uint32_t face;      // equal for the samples of one face, and for no others
  std::int16_t primitive;  // of the instrument
  std::int16_t instrument;
  bool known = true;  // stays in any case (select_new)
};

// Moves the chosen ones to the front, by sample index, instrument and primitive; returns how many of the
// others overlap (gap < 0). Contract: capacity ≤ candidates ≤ max_patch_samples; those of one face are
// adjacent by sample index. Found in that order they are not sorted.
int select_contacts(std::span<ContactCandidate> candidate, int capacity) noexcept;

// The same for the `count` deepest alone; count < candidates.
int keep_deepest(std::span<ContactCandidate> candidate, int count) noexcept;

// Moves to the front, in the same order, all that are known and at most `most` of the others, chosen as
// select_contacts does. Returns how many those are in all.
int select_new(std::span<ContactCandidate> candidate, int most) noexcept;

}  // namespace hapticd
