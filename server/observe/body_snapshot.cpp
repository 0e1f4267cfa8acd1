#include "server/observe/body_snapshot.h"

#include <span>

namespace hapticd {
namespace {

void flatten(std::span<const Vec3> nodes, std::vector<float>& out) {
  out.clear();
  out.reserve(3 * nodes.size());
  for (const Vec3& x : nodes)
    for (int i = 0; i < 3; ++i) out.push_back(static_cast<float>(x[i]));
}

}  // namespace

void take_snapshot(const Body& body, BodySnapshot& out) {
  if (!body.deformable) return;
  const auto nodes = static_cast<std::size_t>(body.model.nodes_in_use);
  const auto tets = static_cast<std::size_t>(body.model.tets_in_use);
  flatten(std::span(body.state.x).first(nodes), out.nodes);
  pack_bits(tets_there(body.model, body.state), tets, out.alive);
  if (out.topology == body.topology) return;
  out.topology = body.topology;
  flatten(std::span(body.rest()).first(nodes), out.rest);
  out.tets.clear();
  for (const Tet& t : std::span(body.model.mesh.tets).first(tets))
    out.tets.insert(out.tets.end(), t.begin(), t.end());
  out.opened.clear();
  for (std::size_t id = 0; id < 4 * tets; ++id)
    if (body.model.across[id] == opened_face) out.opened.push_back(static_cast<std::uint32_t>(id));
}

void pack_bits(const std::vector<std::uint8_t>& flags, std::size_t count, std::vector<std::uint8_t>& bits) {
  bits.assign((count + 7) / 8, 0);
  for (std::size_t i = 0; i < count; ++i)
    if (flags[i]) bits[i / 8] = static_cast<std::uint8_t>(bits[i / 8] | 1u << (i % 8));
}

}  // namespace hapticd
