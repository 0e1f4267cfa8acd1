// Recordings played to a scene, one a device, without DDS or clock: the daemon in virtual time
// (server/schedule/virtual_daemon.h), with everything a device feels: arming, ramp, watchdog, limits, blend,
// pedals.
//
//   tick i at i ms: state in (0.5 ms old), haptic tick, force out; the recording's slot 0 is tick 250, before
//   it the first pose is held, 50 ms without `enable`, as a client does (client.h)
//
// Solves are bounded by counts, never by time, and a scene with `model: auto` keeps what it pins and the
// whole model else, as a plan is made by measured times: two runs of one program on one machine agree bit for
// bit. Another processor rounds otherwise where its kernels differ (front_kernels.h). Units: as in
// haptic/device.h. Errors: std::runtime_error from a singular body and where memory is short,
// std::invalid_argument for a rate above 1 kHz.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "haptic/loop.h"
#include "physics/simulation/world.h"
#include "server/observe/contact_forces.h"
#include "server/scene/scene.h"
#include "server/schedule/late_steps.h"
#include "tools/client/client.h"

namespace hapticd {

// A tick as it was answered, by instrument.
struct ReplayedTick {
  std::int64_t slot = 0;  // negative while arming
  EachInstrument<DeviceCommand> command;
  EachInstrument<ForceRecord> record;
  std::uint32_t removed = 0;  // tetrahedra so far
};

// The scene at the begin of a step that is published now.
struct ReplayedStep {
  std::int64_t slot = 0;  // of the tick that first uses it
  const World& world;
  const StepReport& report;
  const InstrumentSamples samples;            // that it was made with
  const ReplayedTick& newest;                 // tick
  const std::vector<ContactForce>& contacts;  // … as it solved them
  std::uint32_t removed = 0;
};

struct ReplaySinks {
  std::function<void(const ReplayedTick&)> tick;
  std::function<void(const ReplayedStep&)> step;
};

// Asks each source for slots 0 … slots − 1. sources: one an instrument, in their order; an instrument beyond
// them has no client. A state that the watchdog refuses (faster than the device's max_speed) is as if it had
// not come, and is in the tick's status. Ends early when interrupted (interrupt.h), returning false. late:
// absent: each step takes the usual time.
bool replay_offline(const Scene& scene, const std::vector<SlotSource*>& sources, std::int64_t slots,
                    const ReplaySinks& sinks, std::optional<LateSteps> late = {});

}  // namespace hapticd
