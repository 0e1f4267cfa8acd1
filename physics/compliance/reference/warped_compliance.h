// `updown`, `lazy` and `dense`: a reference factor inverse changed by each removal and turned with the nodes.
//
//   C_ij = Q_i C_ij(reference factor) Q_jᵀ,   A(reference factor) ← A(reference factor) − a_e(reference
//   factor) per removal
//
// The reference factor of `updown` is A(u) when it was made; of `lazy` the rest shape, as in the paper;
// `dense` makes its inverse anew whenever a rotation has changed. A removal outside, across or inside the
// zone is the same. When its last tetrahedron goes, a node first gets the identity times A's mean diagonal:
// its row stays regular. A reference factor is made inside `update` the first time, after a change broke
// down, for `updown` in zone-last order when the zone moved, for `lazy` after `lazy_reference_after`
// removals; else by `snapshot_reference`. Accuracy: exact to round-off while nothing has turned since the
// reference factor; then only as good as warping, which `report` measures against the present A(u)
// (residual.h) at the cost of an assembly and two solves, when asked. Contract: removals that nobody told are
// noticed in `update`. Errors: as in compliance.h; std::invalid_argument for a dense body above 3000 nodes.
// Source: the paper, §2.3 and eqs. (3) to (8).
#pragma once

#include "physics/compliance/compliance.h"

namespace hapticd {

// method: lazy, updown or dense.
std::unique_ptr<Compliance> make_warped_compliance(ComplianceMethod method, const TissueModel& model,
                                                   double h, const ComplianceOptions& options);

}  // namespace hapticd
