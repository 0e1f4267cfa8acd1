// From a checked scene to the world the simulation steps, and to how the haptic loop solves its problems.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "haptic/haptic_step.h"
#include "physics/simulation/world.h"
#include "server/scene/scene.h"

namespace hapticd {

WorldSettings world_settings(const Scene& scene);
HapticOptions haptic_options(const Scene& scene);

// One an instrument, in their order.
std::vector<Instrument> shapes_of(const Scene& scene);
std::vector<DeviceSettings> devices_of(const Scene& scene);

// Throws std::invalid_argument where the physics refuses what the scene reader could not see.
std::unique_ptr<World> make_world(const Scene& scene);
std::unique_ptr<World> make_world(const Scene& scene, const WorldSettings& settings);

// What a running world keeps in memory, as measured (server/MEASURED.md#memory) [bytes].
std::int64_t memory_of(const Scene& scene) noexcept;

}  // namespace hapticd
