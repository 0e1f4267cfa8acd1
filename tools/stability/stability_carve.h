// The cataract scene carved to pieces: seeded grooves, plunges and sweeps, until little is left.
//
// A script leads the device where no hand could go: grooves deeper and deeper along and across the anterior
// face down to the posterior one, plunges through the lens into the capsule, sweeps to the equator and along
// the capsule, quarters eaten away, and rests in which what is left lies alone. 1 to 12 mm/s in the scene,
// pedals up or down, the scene's rate of removal or three times that, reference factors one to four steps
// late, a fresh scene every `episode` ticks. Every third seed first cuts round a core, at ten times the rate
// and without suction, so that a free piece is left and pushed about. The daemon is that of renderer.h, with
// interim problems and refreshes; the device is the scene's with its own limits. Looked at: trial_tally.h,
// and after each step that no free piece has made energy; what throws is an end. An episode ends at its first
// fault, which is kept with its seed. Deterministic, on however many cores.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "server/scene/scene.h"
#include "tools/stability/bench/trial_tally.h"

namespace hapticd {

struct CarveSettings {
  std::int64_t ticks = 1'000'000;
  std::int64_t episode = 100'000;
  std::uint64_t seed = 1;  // of the first episode; each further one has the next
  double late_steps = 0;   // random_hands.h
};

struct CarveFault {
  std::uint64_t seed = 0;
  std::int64_t tick = 0;
  std::string what;
};

struct CarveReport : TrialTally {
  double late_steps = 0;  // their spread
  std::int64_t strokes = 0;
  double made = 0, made_allowed = 0;  // by a free piece [J]
  std::int64_t free_steps = 0;        // with a free piece
  double free_energy = 0;             // largest of one when it was let go; 0: there was none [J]
  std::vector<CarveFault> faults;
};

// `progress(fraction)` returns false to stop.
CarveReport run_carve(const Scene& cataract, const CarveSettings& settings,
                      const std::function<bool(double)>& progress);

}  // namespace hapticd
