// Where a body stands, and what differs from part to part of it: keys of an entry of `bodies`.
//
//   x = position + orientation · scale · x_mesh          [m]
//
// Placement applies to the mesh once, when it is read: everything after sees a mesh that was written there.
// Errors: InputError with file, line and key.
#pragma once

#include "server/files/yaml_keys.h"
#include "server/scene/scene.h"

namespace hapticd {

// position, orientation, scale.
void place(const YamlMap& body, TetMesh& mesh);

std::vector<std::string> group_names(const TetMesh& mesh);

// The group of a name that stands under `key`.
const MeshGroup& named_group(const YamlMap& yaml, const std::string& key, const std::string& name,
                             const TetMesh& mesh);

// regions, stretch: each tetrahedron is in one at most.
std::vector<TissueRegion> read_regions(const YamlMap& body, const TetMesh& mesh, const Material& material);

// springs: one a node of the mesh; empty: there are none.
std::vector<NodeSpring> read_springs(const YamlMap& body, const TetMesh& mesh);

// Per face id, those in the groups that `clefts` names: where cracks begin. Empty: no group is named.
std::vector<std::uint8_t> read_clefts(const YamlMap& tearing, const TetMesh& mesh);

Material read_material(const YamlMap& yaml);

}  // namespace hapticd
