// What an operation leaves of a scene's bodies by some instant, for runs that begin there.
//
// The daemon in virtual time along the scene's own trajectories from where they begin, with pedals, suction,
// tearing and everything a device feels, as `haptic replay --offline` runs it. A body is taken at the begin
// of the first step at or after the instant: as removed and torn, and moving. Contact is not taken: whoever
// begins there finds it again within a few steps, friction without what it held. Units: s of the
// trajectories. Errors: InputError for an instrument without a trajectory; those of run_offline.
#pragma once

#include <memory>
#include <vector>

#include "physics/simulation/body.h"
#include "tools/offline/offline_run.h"

namespace hapticd {

using BodyStarts = std::vector<std::shared_ptr<const BodyStart>>;  // per body; null: it stands still

// One for each instant, in any order; at rest where it is not after the trajectories' begin. None where
// progress ended the run, or the trajectories end before the last instant.
std::vector<BodyStarts> bodies_along_trajectories(const Scene& scene, const std::vector<double>& instants,
                                                  const OfflineProgress& progress = {});

// The scene with bodies that begin so, and are cut and torn no further.
Scene begun_from(const Scene& scene, const BodyStarts& starts);

}  // namespace hapticd
