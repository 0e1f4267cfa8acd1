// `updown`, `lazy` and `dense`: the inverse of an earlier A, changed by each removal and turned with the
// nodes.
//
//   C_ij = Q_i C_ij(reference) Q_jᵀ,   A(reference) ← A(reference) − a_e(reference) per removal
//
// The earlier A is, for `updown`, A(u) when it was made; for `lazy` that of the rest shape, as in the paper;
// for `dense` the present one: its inverse is made anew whenever a rotation has changed. A removal outside,
// across or inside the zone is the same. When its last tetrahedron goes, a node first gets the identity times
// A's mean diagonal, so that its row stays regular.
// `update` makes a reference factor itself the first time; after a cut, of the new mesh, at once (these are
// methods to compare with); after a change broke down; for `updown` in
// zone-last order when the zone moved; for `lazy` after `lazy_reference_after` removals.
// Accuracy: exact to round-off while nothing has turned since; then as good as warping, which `report`
// measures against the present A(u) (residual.h) at the cost of an assembly and two solves. Removals that
// nobody told are noticed in `update`. Errors: as in compliance.h; std::invalid_argument for h ≤ 0, and for a
// dense body above 3000 nodes. Source: the paper, §2.3 and eqs. (3) to (8).
#pragma once

#include "physics/compliance/reference_compliance.h"

namespace hapticd {

// method: lazy or updown.
[[nodiscard]] std::unique_ptr<ReferenceCompliance> make_warped_compliance(ComplianceMethod method,
                                                                          const TissueModel& model, double h,
                                                                          const ComplianceOptions& options);

[[nodiscard]] std::unique_ptr<Compliance> make_dense_compliance(const TissueModel& model, double h,
                                                                const ComplianceOptions& options);

}  // namespace hapticd
