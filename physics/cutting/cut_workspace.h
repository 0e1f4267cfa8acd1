// What opening and subdivision keep between cuts, and their scratch: one for each model.
//
// Guarantee: the constructor takes all room, so cuts allocate nothing. It also reserves the room of the
// model's groups. Pre: the model's topology is changed by cuts with this workspace alone, and by removals.
#pragma once

#include <cstdint>
#include <vector>

#include "physics/cutting/star_index.h"
#include "physics/tissue/tissue.h"

namespace hapticd {

struct CutWorkspace {
  explicit CutWorkspace(TissueModel& model);

  StarIndex stars;
  std::vector<std::uint8_t> held_open;  // per face id: is to open, but all three nodes still join its sides

  // Scratch.
  std::vector<int> star, other_star, nodes, faces, stack;
  std::vector<int> label;  // per tetrahedron; −1 between calls
};

// Mass and count of live tetrahedra of a node, summed from nothing over its star.
void sum_star(const TissueModel& model, TissueState& state, CutWorkspace& work, int node) noexcept;

// Takes the next spare node into use. Pre: there is one.
int take_node(TissueModel& model) noexcept;

}  // namespace hapticd
