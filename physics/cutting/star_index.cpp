#include "physics/cutting/star_index.h"

#include <algorithm>

namespace hapticd {

StarIndex::StarIndex(const TissueModel& model)
    : head_(model.mesh.nodes.size(), -1), next_(4 * model.mesh.tets.size(), -1) {
  for (int t = 0; t < model.tets_in_use; ++t)
    for (int corner = 0; corner < 4; ++corner) link(model.mesh.tets[t][corner], t, corner);
}

void StarIndex::live(const TissueState& state, int node, std::vector<int>& star) noexcept {
  star.clear();
  for (int* place = &head_[node]; *place >= 0;) {
    if (state.alive[*place / 4]) {
      star.push_back(*place / 4);
      place = &next_[*place];
    } else {
      *place = next_[*place];
    }
  }
  std::sort(star.begin(), star.end());
}

void StarIndex::link(int node, int tet, int corner) noexcept {
  next_[4 * tet + corner] = head_[node];
  head_[node] = 4 * tet + corner;
}

void StarIndex::unlink(int node, int tet, int corner) noexcept {
  int* place = &head_[node];
  while (*place >= 0 && *place != 4 * tet + corner) place = &next_[*place];
  if (*place >= 0) *place = next_[*place];
}

}  // namespace hapticd
