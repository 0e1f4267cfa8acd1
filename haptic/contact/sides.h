// About which instruments two solves of the same contact have tissue on different sides.
//
//   a' = X_b X_a⁻¹ a;   the way from a' to b leads through the instrument, deeper than a quarter of the alarm
//   distance, and by as much deeper than a' is
//
// a and b: where each has a sample; X_a, X_b: where each has the instrument, so that one that has moved on
// with what it presses is on the same side. An instrument of which one of the two knows nothing is on none.
// Units: m. Guarantee: wait-free, no allocation, bounded by 8 × max_patch_samples × primitives.
#pragma once

#include "physics/contact/rows.h"

namespace hapticd {

EachInstrument<bool> on_other_side(const CondensedProblem& problem, Instruments instruments,
                                   const InstrumentPoses& X_a, const PatchPositions& a,
                                   const InstrumentPoses& X_b, const PatchPositions& b) noexcept;

}  // namespace hapticd
