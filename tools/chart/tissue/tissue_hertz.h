// A sphere and a large soft block pressed together by contact of bodies, quasi-static, for Hertz's solution.
//
// The block is n × n × n/2 cells drawn together about the contact, 60 contact radii deep and to each side;
// all sizes fall alike with n. A soft sphere is such a block too, upside down, whose face is r²/2R away out
// to four contact radii: Hertz's own gap between half-spaces, of E* = 1/Σ (1 − ν²)/E. Units: m, N.
#pragma once

#include "physics/tissue/mesh.h"

namespace hapticd {

// A block below z = 0, its nodes drawn together about the origin: x = half sinh(β s)/sinh β.
TetMesh graded_block(int n, double half, double beta);

inline constexpr double hertz_young = 10e3, hertz_poisson = 0.3, hertz_radius = 10e-3;

struct HertzResult {
  double force = 0;        // on the sphere [N]
  double element = 0;      // size at the contact, in contact radii
  int dropped = 0;         // contacts beyond capacity
  double penetration = 0;  // [m]
};
HertzResult hertz_by_bodies(double depth, int cells);  // a rigid sphere

// A soft one: its material, its cells; without friction, either one's nodes against the other's faces.
inline constexpr double soft_sphere_young = 25e3, soft_sphere_poisson = 0.4;
HertzResult hertz_of_soft_bodies(double depth, int cells, int sphere_cells);
double hertz_force_of_soft_bodies(double depth);

}  // namespace hapticd
