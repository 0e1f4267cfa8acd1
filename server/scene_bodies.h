// The parts of a scene file that describe things: bodies and the instrument (scene_reader.h).
#pragma once

#include "server/scene.h"
#include "server/yaml_keys.h"

namespace hapticd {

SceneBody read_body(const YamlMap& yaml);
Instrument read_instrument(const YamlMap& yaml);

}  // namespace hapticd
