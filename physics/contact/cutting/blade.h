// A blade: the cutting edge of an instrument, cut into samples of equal length.
//
//   edge: polyline p(s), 0 ≤ s ≤ L; sample k is its part kL/N ≤ s ≤ (k+1)L/N
//   place = p((k+½)L/N),   width w_k = ∫ ‖p'(s) × d‖ ds over the part
//
// d is the direction in which it cuts, from the blade into the tissue. An advance a along d separates the
// area w_k a, so J w_k is what a sample's force is limited to (edge_sample.h). The sheet behind the edge is
// made of ordinary primitives, both of whose sides touch tissue. Units: m, instrument's frame.
#pragma once

#include <vector>

#include "physics/contact/cutting/edge_sample.h"

namespace hapticd {

struct BladePoint {
  Vec3 place;
  double width;  // across d [m]
};

struct Blade {
  std::vector<Vec3> edge;          // its corners, in order
  Vec3 direction = Vec3::Zero();   // unit
  std::vector<BladePoint> sample;  // none: no blade
};

// Throws std::invalid_argument: fewer than two points, a piece without length, no direction, one along the
// whole edge, or a number of samples outside 1 to max_edge_samples.
Blade make_blade(const std::vector<Vec3>& edge, const Vec3& direction, int samples);

// One sample of an instrument's blade against no front yet: node, weight, limit, body and advance are the
// front's.
EdgeSample edge_sample(const Blade& blade, int instrument, int k) noexcept;

}  // namespace hapticd
