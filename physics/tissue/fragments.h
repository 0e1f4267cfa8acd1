// The connected pieces of the live tissue: what a cut has set free.
//
// Two live tetrahedra belong to the same fragment when a chain of shared faces joins them: an edge or a node
// has no area, and tissue that hangs by one alone is a hinge that nothing holds. They belong to the same
// *piece* when a chain of shared nodes joins them: what moves one of it moves all. Both are numbered by their
// lowest tetrahedron, so the numbering does not depend on how they were found.
// Units: volume at rest [m³]. Cost: one pass of union–find over the tetrahedra.
#pragma once

#include <span>
#include <vector>

#include "physics/tissue/tissue.h"

namespace hapticd {

struct Fragment {
  std::vector<int> tets;  // ascending
  bool held = false;      // some node of it is fixed or has a spring
  double volume = 0;
};

// Per tetrahedron the number of its fragment, or of its piece; -1 for removed ones.
std::vector<int> label_fragments(const TissueModel& model, const TissueState& state);
std::vector<int> label_pieces(const TissueModel& model, const TissueState& state);

// The pieces, tetrahedra and nodes numbered; -1 for removed tetrahedra and nodes that have none left.
struct Pieces {
  std::vector<int> of_tet, of_node;
  std::vector<char> held;  // some node of it is fixed or has a spring
  int count() const noexcept { return static_cast<int>(held.size()); }
};
Pieces find_pieces(const TissueModel& model, const TissueState& state);

// The fragments themselves, indexed by their labels.
std::vector<Fragment> find_fragments(const TissueModel& model, const TissueState& state);

// Tetrahedra of the fragments of at most `most` that hold one of `changed`, or share a face with a removed
// one of them, and can turn about what they hang on: springs, and an edge or nodes of others; or fewer than
// three nodes, some of them fixed. Next to nothing resists that, and a step with rotations held takes what
// turns far out of its shape: left alone such a crumb spins faster and faster, and suction throws it
// (README). Cost: `most` tetrahedra for each of changed.
std::vector<int> hinged_fragments(const TissueModel& model, const TissueState& state,
                                  std::span<const int> changed, int most);

}  // namespace hapticd
