// Reads a haptic device's limits (config/devices/*.yaml).
//
// Units: N, N·m, N/s, m/s, m, N·s/m, N/m. The map between device and scene is the scene's (scene_reader.h).
// Errors: InputError with file, line and key.
#pragma once

#include <filesystem>
#include <string>

#include "haptic/device.h"

namespace hapticd {

struct DeviceFile {
  std::string name;
  DeviceSettings limits;
  double max_stiffness = 0;  // largest the device displays stably [N/m]
};

DeviceFile read_device(const std::filesystem::path& file);

// By a name of config/devices or by path (paths.h).
DeviceFile read_named_device(const std::string& name_or_path, const std::filesystem::path& base);

// What to say where the file for that name is not there: which there are, and the nearest.
std::string no_such_device(const std::string& name, const std::filesystem::path& file);

}  // namespace hapticd
