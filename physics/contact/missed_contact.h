// What a contact solve let through the instrument, because no row was there to hold it.
//
//   gap(s_lin) ≥ held and no row, but   gap(s_lin) + n·(s_end − s_lin) + J_n (X_end ⊖ X_lin) < −allowed
//
// allowed is 0 where gap(s_lin) < margin: a solve of fewer rows (held < margin) that lets nothing through is
// the solve of all up to the margin, the rows left out having no force and no overlap. It is the margin
// beyond that, for tissue alone. Linearised where it came from: the true gap at the end does not tell, for
// what has passed through is outside again, or met by normals of the instrument's far side. Gaps change by no
// more than points move: a solve that moved nothing by `held` (twice the margin, where that is what was held)
// is not looked at further.
// Units: m. Guarantee: wait-free, no allocation, bounded by max_patch_samples × primitives.
//
// Which side: a sample may press where n · outward < 0.2, the instrument being on the outer side of its face;
// or, of a deformable body, whichever way its face is turned, not deeper than two fifths of the alarm
// distance and three of the primitive's radius, towards whose axis normals say less and less, where the
// instrument is known to be outside. It is so first when a solve has a force at a sample of the first kind
// and leaves none inside without a row by more than an eighth of the alarm distance; and then while none is
// deeper than half of that distance: to lose some tissue is not to have come in.
#pragma once

#include <algorithm>

#include "physics/contact/candidates/samples_in_reach.h"
#include "physics/contact/placed_instrument.h"
#include "physics/contact/rows.h"

namespace hapticd {

inline constexpr double facing_away = 0.2;  // n · outward beyond which the instrument is on the inner side
// … up to which depth it is not, if outside [alarm distances], and no farther than [radii of the primitive].
inline constexpr double held_up_to = 0.4, thick = 0.6;
inline constexpr double shallow = 0.25;  // deeper than twice that it is no longer outside [alarm distances]

// outside: of the instrument that the gap is to, as the memory has it; radius: of its primitive.
inline bool may_press(const CondensedProblem& problem, int sample, const Gap& gap, double radius,
                      const Vec3& outward, bool outside) noexcept {
  if (gap.normal.dot(outward) < facing_away) return true;
  const double deep = std::min(held_up_to * problem.alarm_distance, thick * radius);
  return outside && problem.sample[sample].node[0] >= 0 && gap.distance > -deep;
}

// Outward unit normal of a sample's triangle (a, b, c), wound outward, when the patch's nodes are at x:
// (b − a) × (c − a) / ‖…‖. The published one of an obstacle, or of a triangle without area. Thin tissue turns
// by half a right angle in a tick, so the published one does not tell which side is its inner one.
Vec3 sample_outward(const CondensedProblem& problem, const PatchPositions& x, int sample) noexcept;

// Gap of the sample that is at s, linearised there, at the end; moved = X_end ⊖ X_lin.
inline double gap_reached(const CondensedProblem& problem, int sample, const Vec3& s, const Gap& gap,
                          const Pose& X_lin, const Vec6& moved, const PatchPositions& x_end) noexcept {
  const Vec3 instrument = moved.head<3>() + moved.tail<3>().cross(s - X_lin.p);
  return gap.distance + gap.normal.dot(sample_position(problem, x_end, sample) - s - instrument);
}

// in_reach: of the problem's samples, kept by the caller.
bool violates_inactive_contact(const CondensedProblem& problem, Instruments instruments,
                               const InstrumentPoses& X_lin, const PatchPositions& x_lin, double held,
                               double margin, const EachInstrument<bool>& outside, const ContactRows& rows,
                               const Reached& end, SamplesInReach& in_reach) noexcept;

// Whether an instrument is outside after a solve that took patch and rows to x_end and left samples without
// rows as deep as `lost`; before: whether it was.
bool is_outside(const CondensedProblem& problem, int instrument, bool before, const ContactRows& rows,
                std::span<const double> lambda, const PatchPositions& x_end, double lost) noexcept;

// Of one instrument at the end of a solve: the deepest true overlap of any sample [m], ≥ 0; `lost` grows to
// that of the samples that no row holds. in_reach: all that can be inside.
double deepest_overlap(const CondensedProblem& problem, const PlacedInstrument& placed, int instrument,
                       std::span<const SamplesInReach::Entry> in_reach, const ContactRows& rows,
                       const PatchPositions& x_end, double& lost) noexcept;

// The longest translation of those that at X have a sample or another instrument within the alarm distance:
// what the others do, far away, is nothing to a solve. Of one instrument alone it is its own [m].
double longest_in_reach(const CondensedProblem& problem, Instruments instruments, const InstrumentPoses& X,
                        const EachInstrument<Vec6>& way) noexcept;

}  // namespace hapticd
