// An instrument as people look at it: what `SceneInstrument.primitives` has, ten numbers a record.
//
//   0 sphere, 1 capsule, 2 cylinder: radius, half length along local z; position, quaternion
//   3 triangle of a convex part: its three corners, wound outward
//
// A blade's edge is a thin capsule a piece: a hundredth of the edge's length thick. Units: m, instrument's
// frame. Errors: none.
#pragma once

#include <vector>

#include "physics/contact/instrument.h"

namespace hapticd {

std::vector<float> instrument_shape(const Instrument& instrument);

}  // namespace hapticd
