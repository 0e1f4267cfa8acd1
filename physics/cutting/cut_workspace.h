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

// Both sides of the face are live and not yet apart.
bool is_inner(const TissueModel& model, const TissueState& state, int face) noexcept;

// Labels the node's star (work.star) by what faces that are not to open connect, in the order of the lowest
// tetrahedron. Returns how many there are. The labels are to be forgotten before the next call.
int label_star(const TissueModel& model, const TissueState& state, CutWorkspace& work, int node) noexcept;
void forget_labels(CutWorkspace& work) noexcept;

// Takes the next spare node into use. Pre: there is one.
int take_node(TissueModel& model) noexcept;

}  // namespace hapticd
