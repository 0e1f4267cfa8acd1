#include "physics/tissue/tissue_parts.h"

#include <stdexcept>
#include <string>

namespace hapticd {

void set_region(TissueModel& model, const TissueRegion& region) {
  if (!(region.stretch.minCoeff() > 0)) throw std::invalid_argument("a stretch must be above 0");
  const double larger = region.stretch.prod();
  Elasticity law = elasticity(region.material);
  law.density *= larger;
  for (const int t : region.tets) {
    if (t < 0 || t >= model.tets_in_use)
      throw std::invalid_argument("a region names tetrahedron " + std::to_string(t) + " of " +
                                  std::to_string(model.tets_in_use));
    model.elastic[t] = law;
    model.gradients[t] = region.stretch.asDiagonal() * model.gradients[t];
    model.volume[t] /= larger;
  }
}

void set_springs(TissueModel& model, std::span<const NodeSpring> springs) {
  if (springs.empty()) return;
  if (static_cast<int>(springs.size()) > model.node_count())
    throw std::invalid_argument("springs on " + std::to_string(springs.size()) + " nodes of " +
                                std::to_string(model.node_count()));
  model.springs.assign(springs.begin(), springs.end());
  model.springs.resize(model.mesh.nodes.size());
}

}  // namespace hapticd
