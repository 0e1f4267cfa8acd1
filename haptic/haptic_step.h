// One tick of the haptic loop as a pure function: the devices' states in, their forces out.
//
//   δ_free(X) → λ → wrench_i = J_iᵀλ → device axes and scale → + ghost → blend → gain → limits → force
//
// One contact solve for all devices of a world; all else is each device's own: watchdog, scales, ramp,
// limits, latch. It reads in this order: read, compute, filter, limit, check finite, answer. Every path to an
// answer goes through the limits or is exactly zero. An instrument whose device is not trusted in this tick
// has no rows; one whose device is silent for less than 10 ms, its force held, stays where it was. Who comes
// or goes is blended for the others. The loop fills in wake_ns and solve_ns of the answers, because there is
// no clock here. Units: m, N, N·m, ns; answers are in the device's frame. Guarantee: noexcept, no allocation,
// wait-free, bounded by the contact solve's bound.
#pragma once

#include "haptic/contact/viscous_patch.h"
#include "haptic/limits.h"
#include "haptic/passivity.h"
#include "haptic/watchdog.h"
#include "physics/contact/contact_solve.h"

namespace hapticd {

struct HapticOptions {
  WatchdogLimits watchdog;
  ContactOptions contact;
  ViscousOptions viscous;
  double blend_time = 5e-3;  // after removals and changes of who is in contact [s]; 0: none
  double thinning_time = 0;  // … in place of it where tissue became less by degrees, whether some went or not
  // Residual (natural map). A solve that ended at its cap or deadline with a larger one is resumed in the
  // next ticks (contact_solve.h), and the wrench goes half-way to the resumed one each tick. Without any
  // progress the last good wrench is held for 10 ms, then fades in 90 ms. It is held, and tissue with
  // it, for 5 ms where an unfinished solve leaves tissue deeper inside than before and than `too_deep`.
  double usable_residual = 1e-3;
  // Samples become rows at once if this many ticks like this one can reach them, or if they are within a
  // fifth of the margin (ContactOptions::activation_distance). Infinity: all within the margin.
  double ticks_ahead = 3;
  // Of the contact solve, from the tick's intended time; three quarters of it at least from its begin. The
  // loop keeps the clock.
  std::int64_t solve_budget_ns = 800'000;
  bool passivity_control = false;  // the tank (passivity.h); the observer always runs
};

struct DeviceInput {
  Presence presence;
  bool taken = false;  // `sample` is new
  DeviceSample sample;
};

struct HapticInput {
  std::int64_t now_ns = 0;     // CLOCK_MONOTONIC
  std::int64_t period_ns = 0;  // since the previous tick, where ticks come at will; 0: the watchdog's
  EachInstrument<DeviceInput> device;
  Deadline deadline;  // of the contact solve; none: bounded by counts alone
};

// Of one device.
struct DeviceState {
  WatchdogState watchdog;
  Blend blend;
  PassivityState passivity;
  Render render = Render::zero;    // of the previous tick
  bool present = false;            // its instrument may touch: of the previous tick
  Wrench rendered;                 // of the previous tick, before gain and limits
  Wrench sent;                     // of the previous tick
  Vec3 controlled = Vec3::Zero();  // … the passivity controller's part of it, before the limits
  Wrench good;                     // of the last usable contact solve, as rendered
  double vacuum = 0;               // of its instrument's pump [Pa] …
  double occlusion = 0;            // … and how far its port was covered
};

// About 5 MB of scratch: keep it on the heap, made before the loop starts.
struct HapticState {
  EachInstrument<DeviceState> device;
  ContactState contact;
  ContactScratch scratch;
  ViscousPatch patch;
  double unusable_for = 0;  // contact solves in a row, so long [s]
  double overlap = 0;       // that the last usable one left, or one that was near [m]
  std::uint32_t caps = 0;   // contact solves so far that ended at a cap or the deadline
  std::uint64_t tick = 0;
  std::uint64_t step = 0;        // newest simulation step rendered
  std::uint64_t sound_step = 0;  // newest problem looked at and found sound
  InstrumentPoses X;             // of those in contact, in the last contact solve
  InstrumentPoses placed;        // where the last usable solve put them
  EachInstrument<bool> astray;   // in this tick the solve began anew (contact/tick_solve.h)
  EachInstrument<Vec6> behind;   // its device, in the last solve; ticks make up for it
  double left_inside = 0;        // of tissue, that beginning anew in this problem did not free [m]
  bool solved = false;           // this tick ran the contact solve …
  ContactSolution solution;      // … and this came out, in the scene

  bool any_astray() const noexcept { return astray.value != EachInstrument<bool>().value; }
  bool in_contact(int i) const noexcept { return solved && X.present[i]; }
};

// problem: the newest, or null when there is none yet.
// devices: one an instrument, in their order.
EachInstrument<ForceSample> haptic_step(const CondensedProblem* problem, Instruments instruments,
                                        std::span<const DeviceSettings> devices, const HapticOptions& options,
                                        const HapticInput& input, HapticState& state) noexcept;

// What the simulation is told of all instruments of a world.
using InstrumentInputs = EachInstrument<InstrumentInput>;

// The instrument's state that the simulation should use after this tick.
InstrumentInput instrument_input(const DeviceSettings& device, const WatchdogLimits& limits,
                                 const WatchdogState& state, std::int64_t now_ns) noexcept;

}  // namespace hapticd
