// The parts of a scene file that describe things: bodies, which of them touch, and the instrument
// (scene_reader.h).
#pragma once

#include <algorithm>

#include "server/files/yaml_keys.h"
#include "server/scene/scene.h"

namespace hapticd {

SceneBody read_body(const YamlMap& yaml);
// The choices of a body's model that stand in its own map: elements, motion, simulated.
void read_body_pins(const YamlMap& yaml, SceneBody& body);
inline bool is_stretched(const SceneBody& body) {
  return std::ranges::any_of(body.regions, [](const TissueRegion& r) { return r.stretch != Vec3::Ones(); });
}
// Held, never cut, and at rest where its mesh stands: what needs no mass.
inline bool may_be_static(const SceneBody& body) {
  return !body.fixed_nodes.empty() && body.springs.empty() && !is_stretched(body) && !body.removable && !(body.toughness > 0);
}

// One entry of `contacts`: the first body's surface nodes against the second's faces.
ContactPair read_contact(const YamlMap& yaml, const std::vector<SceneBody>& bodies);

Instrument read_instrument(const YamlMap& yaml);

}  // namespace hapticd
