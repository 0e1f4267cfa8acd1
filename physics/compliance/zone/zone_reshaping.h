// A reference factor of method `zone` follows a cut: what it has of the tetrahedra becomes what the model
// has.
//
// The nodes of what was cut that are outside the corner are taken into it, new ones are appended, and the
// corner takes the new forms from the next update on. Why that is exact and definite: zone_reference.cpp.
// Cost: what was cut, and a half solve for each node that is taken in.
#pragma once

#include <span>

#include "physics/compliance/zone/zone_factor.h"

namespace hapticd {

// `tets`: those that may differ, no duplicates. `rotation`: per tetrahedron, at the reference factor. `gone`:
// per tetrahedron, no longer in the factor; of those that live now, and those that a cut changed before they
// went, it is set here. Returns false if round-off spoilt the factor.
[[nodiscard]] bool follow_reshaped(ZoneReference& reference, ZoneFactor& factor, const TissueModel& model,
                                   const TissueState& state, std::span<const Mat3> rotation,
                                   std::span<std::uint8_t> gone, std::span<const int> tets);

}  // namespace hapticd
