// Opening a set of interior faces: nodes double, elements are re-pointed, volume is kept exactly.
//
// For each node of these faces, the live tetrahedra of its star fall into components that faces which are not
// open connect. The component of the lowest tetrahedron keeps the node; every other gets a double of it, with
// the same rest place, x, v, fixed flag and groups. Elements keep id, shape and rotation.
//   A face whose three nodes all still join its two sides has not opened: it cannot move apart. It is
//   remembered
// (CutWorkspace::held_open) and opens with the first opening that doubles one of its nodes. So a surface may
// be opened face by face, in any order.
// Where a face has opened, `across` (surface.h) is `opened_face` on both sides.
// Cost: the stars of the faces' nodes. Guarantee: no allocation. Errors: CutStatus; with `no_room` nothing
// has changed.
#pragma once

#include <span>

#include "physics/cutting/cut_workspace.h"
#include "physics/cutting/topology_change.h"

namespace hapticd {

// Faces by either of their ids. Those on the boundary, or of removed tetrahedra, are skipped.
[[nodiscard]] CutStatus open_faces(TissueModel& model, TissueState& state, CutWorkspace& work,
                                   std::span<const int> faces, TopologyChange& change) noexcept;

// Of these nodes, those at which tissue hangs by the node alone, or by an edge, without a face: they are
// parted in the same way. Cost, guarantee and errors as above.
[[nodiscard]] CutStatus part_hinges(TissueModel& model, TissueState& state, CutWorkspace& work,
                                    std::span<const int> nodes, TopologyChange& change) noexcept;

}  // namespace hapticd
