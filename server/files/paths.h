// Where the shipped configuration lies: the environment variable HAPTICD_CONFIG_DIR; else ../share/hapticd
// beside the program's folder, which an installed tree has and a build has too; else where the project was
// configured to be installed (a driver in a folder of its own). A device or DDS profile of this machine's own
// in ETC/hapticd goes before the shipped one of the same name, unless the variable is set.
#pragma once

#include <filesystem>
#include <string>

namespace hapticd {

std::filesystem::path config_directory();

// A file of it ("dds/loopback.xml"), or this machine's own in its place.
std::filesystem::path config_file(const std::filesystem::path& relative);

// A device by name ("touch" → devices/touch.yaml of the configuration) or by path (anything with a slash or
// an extension; relative to `base`).
std::filesystem::path device_path(const std::string& name_or_path, const std::filesystem::path& base);

// Whether it is there and a file; false too where that cannot be told (a name too long, a folder that is
// closed).
bool is_file(const std::filesystem::path& path);

// The whole content of a file. Throws InputError when it cannot be read.
std::string read_bytes(const std::filesystem::path& file);

}  // namespace hapticd
