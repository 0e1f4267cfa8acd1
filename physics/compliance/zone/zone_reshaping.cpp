#include "physics/compliance/zone/zone_reshaping.h"

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "physics/compliance/zone/shape_change.h"

namespace hapticd {

CarriedShapes follow_reshaped(ZoneReference& reference, ZoneFactor& factor, const TissueModel& model,
                              const TissueState& state, std::span<const Mat3> rotation,
                              std::span<std::uint8_t> gone, std::span<const int> tets) {
  const int first_new = reference.node_count() + reference.appended();
  reference.append(model);
  factor.grow_corner();

  // What was split from one tetrahedron stays together, so that its nodes never lose all they have.
  std::map<int, int> lowest;  // node, by ancestor
  for (const int t : tets) {
    const int ancestor = known_ancestor(model, reference.elements(), t);
    Tet corners = model.mesh.tets[t];
    std::sort(corners.begin(), corners.end());
    const auto lowest_new = std::lower_bound(corners.begin(), corners.end(), first_new);
    const int node = lowest_new != corners.end() ? *lowest_new : corners[0];
    const auto at = lowest.emplace(ancestor, node).first;
    at->second = std::min(at->second, node);
  }
  std::map<int, std::vector<SignedElement>> groups;
  std::vector<std::pair<int, SystemMatrix::Element>> now;
  for (const int t : tets) {
    std::vector<SignedElement>& group = groups[lowest[known_ancestor(model, reference.elements(), t)]];
    const SystemMatrix::Element& before = reference.elements()[t];
    if (before.node != no_tet && !gone[t] && !reference.is_inside(t))
      group.push_back({before, rotation[t], -1});
    gone[t] = !state.alive[t];
    if (!state.alive[t]) continue;
    now.emplace_back(t, element_of(model, t));
    if (!reference.lies_inside(now.back().second)) group.push_back({now.back().second, rotation[t], 1});
  }
  for (const auto& [t, element] : now) reference.reshape(t, element);

  CarriedShapes carried;
  std::vector<ShapeChange> changes;
  for (const auto& [node, group] : groups)
    if (!group.empty()) changes.push_back(shape_change(reference.law(), reference.fixed(), group));
  for (const ShapeChange& c : changes) {
    carried.columns += static_cast<int>(c.added.cols() + c.taken_out.cols());
    carried.definite = factor.carry(c.nodes, c.added, TermSign::add) && carried.definite;
  }
  for (const ShapeChange& c : changes)
    carried.definite = factor.carry(c.nodes, c.taken_out, TermSign::take_out) && carried.definite;
  return carried;
}

}  // namespace hapticd
