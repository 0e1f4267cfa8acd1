// The contact solve of a tick: of the newest problem, at the devices' newest poses.
//
// Where elements went since the last tick, the last problem is pressed on until the instant of publication,
// and the new one from there. A problem that an instrument has outrun is met where it was made, and on the
// way from there. Each loop carries its own contact from problem to problem, and a sample may slip by between
// two others: where a new problem has tissue on another side of an instrument (sides.h), or a solve has lost
// some 0.1 mm inside one (more than beginning anew in this problem left there), the simulation has the word:
// the loop goes on from its contact, at the devices' poses that this is of, and makes up for the way from
// there in the ticks that follow, an eighth of it or 20 um in each. Ports take hold with a time constant of
// 2 ms; what they would throw is not drawn. A problem, its free motion or a solution that is no number is no
// contact, and is said.
// Units: m, N, s. Guarantee: noexcept, no allocation, bounded by 16 contact solves.
#pragma once

#include "haptic/haptic_step.h"

namespace hapticd {

// period: of the tick. False: the problem, or what came out, is no number.
bool solve_tick(const CondensedProblem& problem, Instruments instruments, const InstrumentPoses& X,
                const HapticOptions& options, const HapticInput& input, double period,
                HapticState& state) noexcept;

bool is_usable(const ContactSolution& solution, const HapticOptions& options) noexcept;

// Nothing of what was is known any more.
void forget_contact(HapticState& state) noexcept;

}  // namespace hapticd
