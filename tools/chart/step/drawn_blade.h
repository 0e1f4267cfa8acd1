// What charts of cutting draw: a blade with a thin sheet behind it, and its way through a lens.
//
// The edge is along z of the instrument's frame, its middle at the origin, and cuts along x; the sheet begins
// 3 mm behind it. Through a lens the blade goes from rim to rim at constant height and speed, is lifted out,
// turned about z by half a turn and set down beside the rim, a little to the side: each cut is parallel to
// the last. Units: SI. Errors: std::invalid_argument from make_blade.
#pragma once

#include "physics/contact/instrument.h"

namespace hapticd {

Instrument sheet_blade(double edge_length, int samples);

struct BladePath {
  double speed = 10e-3;    // of a cut; beside the tissue it is three times as fast [m/s]
  double from_rim = 5e-3;  // a cut goes from −from_rim to from_rim [m]
  double apart = 1e-3;     // cuts, from the middle on, in turns on both sides [m]
  double height = 0;       // of the edge's middle [m]
  double lift = 4e-3;      // [m]
};

Pose drawn_blade(const BladePath& way, double t) noexcept;

}  // namespace hapticd
