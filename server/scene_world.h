// From a checked scene to the world the simulation steps.
#pragma once

#include <memory>

#include "physics/simulation/world.h"
#include "server/scene.h"

namespace hapticd {

// Throws std::invalid_argument where the physics refuses what the scene reader could not see.
std::unique_ptr<World> make_world(const Scene& scene);

}  // namespace hapticd
