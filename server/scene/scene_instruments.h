// The hands of a scene: its instruments with their devices, and further devices (scene_reader.h).
//
//   instruments: [...]   one to four in one tissue; an entry holds all that is its own
//   instrument: {...}    one; removal, device, mapping, trajectory and more_devices stand beside it
//
// Errors: InputError with file, line and key; also where both stand there, or a name or an id stands twice.
#pragma once

#include <string>

#include "server/files/yaml_keys.h"
#include "server/scene/scene.h"

namespace hapticd {

// Reads instruments, instrument_friction and more_devices from the file's root; the bodies are already read.
// device: a name or a path that replaces the first instrument's device; empty: the scene's.
void read_instruments(const YamlMap& yaml, const std::string& device, Scene& scene);

}  // namespace hapticd
