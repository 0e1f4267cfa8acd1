// Reads a scene (config/scenes/*/*.yaml, keys in config/README.md) with its meshes, device and trajectory.
//
// Units: SI; meshes in metres unless a body says `mesh_unit`. Paths are relative to the scene file; a
// device may be a name from config/devices. Nothing is started and nothing is guessed: this is the whole of
// `hapticd --check`.
// Errors: InputError with file, line and key for an unknown key (the nearest known one named), a value out of
// its range, a file that is missing or faulty, a group that the mesh has not, a deformable body that
// nothing holds (unless `floating: true`), an unknown tip.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "server/scene/scene.h"

namespace hapticd {

// `device`: a name or a path that replaces the scene's own; empty: the scene's.
Scene read_scene(const std::filesystem::path& file, const std::string& device = "");

bool has_device(const Scene& scene, std::uint32_t id);

// Throws InputError, with the option's name as key, where an id is no instrument's device.
void require_instruments_of(const Scene& scene, const std::vector<std::uint32_t>& ids,
                            const std::string& option);

// One more device by name or path, mapped as the scene's first, with the next free id.
void add_device(Scene& scene, const std::string& name);

}  // namespace hapticd
