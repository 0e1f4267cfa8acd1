// What cuts have done to a mesh since the last clear(): what its followers (surface, compliance, patch) look
// at.
//
// Operations add to it, so one change may hold many. It has the room of its model: adding allocates nothing.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "physics/tissue/tissue.h"

namespace hapticd {

enum class CutStatus {
  done,
  nothing,  // there was nothing to cut: no such edge or no face with another side
  no_room,  // MeshRoom is used up; nothing was changed
  poor,     // it would leave an element below the quality bound; nothing was changed
};

class TopologyChange {
 public:
  explicit TopologyChange(const TissueModel& model);

  void clear() noexcept;
  bool empty() const noexcept { return tets.empty() && opened.empty(); }
  void add_tet(int tet) noexcept;

  std::vector<int> tets;     // corners changed, or new; each once; their parents are in the model
  std::vector<int> nodes;    // new, ascending
  std::vector<int> node_of;  // per new node: which it doubles; −1: it splits an edge
  std::vector<std::array<int, 2>> opened;  // the two ids (surface.h) of each face, when it opened

 private:
  std::vector<std::uint8_t> listed_;  // per tetrahedron: in `tets`
};

}  // namespace hapticd
