// Where two instruments touch or are about to: a row for two of their primitives, the nearest ones first.
//
//   pairs (k of i, l of j), i < j, with gap(k, l) < reach; at most `most_instrument_pairs`
//
// The id says which two primitives they are, and is above the ids of all tissue samples. Units: m. Guarantee:
// wait-free, no allocation, O(primitives²) cheap questions and as many distances as are within reach.
#pragma once

#include <array>
#include <cstdint>

#include "physics/contact/distance/primitive_distance.h"
#include "physics/contact/instruments.h"

namespace hapticd {

inline constexpr int most_instrument_pairs = 8;

struct InstrumentPair {
  int instrument, primitive;   // a
  int other, other_primitive;  // b
  std::uint64_t id;
  PrimitiveGap gap;  // normal: from a to b
};

class InstrumentPairs {
 public:
  InstrumentPairs(Instruments instruments, const InstrumentPoses& X, double reach) noexcept;
  const InstrumentPair* begin() const noexcept { return pair_.data(); }
  const InstrumentPair* end() const noexcept { return pair_.data() + count_; }
  int count() const noexcept { return count_; }

 private:
  void add(const InstrumentPair& pair) noexcept;

  std::array<InstrumentPair, most_instrument_pairs> pair_;  // by id
  int count_ = 0;
};

// Of a pair, or of an instrument and its ring (incision_rows.h); not of a sample.
constexpr bool is_pair(std::uint64_t id) noexcept { return id >> 56 == 0xff; }

}  // namespace hapticd
