// A reference factor of method `zone` follows a cut: what it has of the tetrahedra becomes what the model
// has.
//
// Inside the zone the corner takes the new forms from the next update on; elsewhere the change is carried as
// low-rank terms until the next reference factor, at the rotations that the factor knows. Why the sum is
// exact and definite: zone_reference.cpp. Tetrahedra are taken together by their lowest new node (without
// one: by their lowest), so that what cancels between neighbours is not carried (shape_change.h). Cost: what
// was cut, and columns × carried ones outside the zone.
#pragma once

#include <span>

#include "physics/compliance/zone/zone_factor.h"

namespace hapticd {

struct CarriedShapes {
  int columns = 0;       // of the terms
  bool definite = true;  // false: round-off spoilt a term, and the factor is of no use
};

// `tets`: those that may differ, no duplicates. `rotation`: per tetrahedron, at the reference factor. `gone`:
// per tetrahedron, no longer in the factor; of those that live now, and those that a cut changed before they
// went, it is set here.
CarriedShapes follow_reshaped(ZoneReference& reference, ZoneFactor& factor, const TissueModel& model,
                              const TissueState& state, std::span<const Mat3> rotation,
                              std::span<std::uint8_t> gone, std::span<const int> tets);

}  // namespace hapticd
