#include "physics/compliance/zone/zone_reshaping.h"

#include <algorithm>
#include <vector>

namespace hapticd {

bool follow_reshaped(ZoneReference& reference, ZoneFactor& factor, const TissueModel& model,
                     const TissueState& state, std::span<const Mat3> rotation, std::span<std::uint8_t> gone,
                     std::span<const int> tets) {
  std::vector<int> outside;
  for (const int t : tets) {
    const SystemMatrix::Element& before = reference.elements()[t];
    if (before.node == no_tet || gone[t] || reference.is_inside(t)) continue;
    for (const int n : before.node)
      if (!model.fixed[n] && reference.zone_place(n) < 0) outside.push_back(n);
  }
  std::sort(outside.begin(), outside.end());
  outside.erase(std::unique(outside.begin(), outside.end()), outside.end());
  bool usable = factor.take_in(outside, rotation, gone);

  reference.append(model);
  factor.grow_corner();
  for (const int t : tets) {
    gone[t] = !state.alive[t];
    if (!state.alive[t]) continue;
    const SystemMatrix::Element form = element_of(model, t);
    usable = usable && reference.lies_inside(form);
    reference.reshape(t, form);
  }
  return usable;
}

}  // namespace hapticd
