// A body as the simulation last left it, for whoever shows it.
//
// A cut adds nodes and tetrahedra and gives others new corners: `topology` then counts up, and rest shape and
// corners are those of that count. Units: m. Shapes: those in use alone.
#pragma once

#include <cstdint>
#include <vector>

#include "physics/simulation/body.h"

namespace hapticd {

struct BodySnapshot {
  std::vector<float> nodes;                // 3 per node, present positions; empty for a rigid body
  std::vector<std::uint8_t> alive;         // 1 bit per tetrahedron, least significant first
  int topology = 0;                        // cuts since the scene's own mesh
  std::vector<float> rest = {};            // 3 per node; empty while topology is 0
  std::vector<std::uint32_t> tets = {};    // 4 per tetrahedron; …
  std::vector<std::uint32_t> opened = {};  // ids of the faces that cuts made (surface.h); …
};

// Pre: `out` is empty, or an earlier one of this body: what has not changed is not written again.
void take_snapshot(const Body& body, BodySnapshot& out);

// One bit per entry, least significant first.
void pack_bits(const std::vector<std::uint8_t>& flags, std::size_t count, std::vector<std::uint8_t>& bits);
inline void pack_bits(const std::vector<std::uint8_t>& flags, std::vector<std::uint8_t>& bits) {
  pack_bits(flags, flags.size(), bits);
}

}  // namespace hapticd
