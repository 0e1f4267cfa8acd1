// A soft block held at its bottom, out of its rest shape, and which of its elements a tip would take.
#pragma once

#include <algorithm>
#include <vector>

#include "physics/simulation/body.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd::soft_block_bench {

inline constexpr double h = 0.02;
inline const Vec3 gravity(0, 0, -9.81);

inline BodySettings soft_block(int n, bool corotational, double density = 1000) {
  BodySettings b{"block", true, box_mesh(Vec3(0.02, 0.02, 0.02), n, n, n), {5000, 0.4, density, 5, 0.002}, {},
                 0.2,     true};
  b.fixed_nodes = b.mesh.group("bottom")->nodes;
  b.corotational = corotational;
  return b;
}

// Sheared by a fifth and thrown sideways.
inline void disturb(Body& body) {
  for (int n = 0; n < body.model.node_count(); ++n) {
    if (body.model.fixed[n]) continue;
    body.state.x[n].x() += 0.2 * body.state.x[n].z();
    body.state.v[n] = Vec3(0.01, 10 * body.state.x[n].z(), -0.02);
  }
  update_rotations(body.model, body.state);
}

inline int highest_node(const Body& body) {
  int best = 0;
  for (int n = 0; n < body.model.node_count(); ++n)
    if (body.rest()[n].sum() > body.rest()[best].sum()) best = n;
  return best;
}

// Every tetrahedron at the free corner, which loses its node, and one that shares a face with one of them.
inline std::vector<int> corner_and_neighbour(const Body& body) {
  const int corner = highest_node(body);
  std::vector<int> tets;
  for (int t = 0; t < body.model.tet_count(); ++t)
    if (std::count(body.model.mesh.tets[t].begin(), body.model.mesh.tets[t].end(), corner) > 0)
      tets.push_back(t);
  for (int face = 0; face < 4; ++face)
    if (const int across = body.model.across[4 * tets[0] + face];
        across >= 0 && std::count(tets.begin(), tets.end(), across / 4) == 0) {
      tets.push_back(across / 4);
      break;
    }
  return tets;
}

}  // namespace hapticd::soft_block_bench
