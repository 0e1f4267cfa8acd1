// Where the shipped configuration lies: the environment variable HAPTICD_CONFIG_DIR, else the
// directory the daemon was built with.
#pragma once

#include <filesystem>
#include <string>

namespace hapticd {

std::filesystem::path config_directory();

// A device by name ("touch" → config/devices/touch.yaml) or by path (anything with a slash or an
// extension; relative to `base`).
std::filesystem::path device_path(const std::string& name_or_path, const std::filesystem::path& base);

// The whole content of a file. Throws InputError when it cannot be read.
std::string read_bytes(const std::filesystem::path& file);

}  // namespace hapticd
