// A blade drawn through a block at constant depth: what the hand feels, and where its work goes.
//
//   F = J D,   ∫ F·v dt = J · area + ΔE + damped
//
// A block is held at its bottom. A vertical edge, longer than the cut is deep, is drawn along x at 10 mm/s,
// with a thin sheet behind it; steps of h, `exact`, no friction. Means are over the middle of the way, after
// onset. D: that of the samples below the block's top, of which the blade has a whole number there and a
// quarter of one too many. Units in the names. Errors: none. Source: DESIGN §11; Atkins, The Science
// and Engineering of Cutting (2009), ch. 3.
#pragma once

#include <vector>

namespace hapticd {

struct BladeDraw {
  double h_ms = 0;
  int mesh = 0;  // cells over the block's height
  double force_n = 0, force_deviation_n = 0, expected_n = 0;
  double work_j = 0, area_m2 = 0, released_j = 0;  // released_j: J times the area
  double elastic_j = 0;                            // change of stored energy over the same way
  int steps = 0, split_steps = 0;
  int nodes_added = 0;
  double step_ms_p99 = 0;
};

BladeDraw draw_blade(double h, int cells);

}  // namespace hapticd
