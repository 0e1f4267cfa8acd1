// A rigid sphere pressed into a large soft block by contact of bodies, quasi-static, for Hertz's solution.
//
// The block is n × n × n/2 cells drawn together about the contact, 60 contact radii deep and to each side;
// all sizes fall alike with n. Units: m, N.
#pragma once

namespace hapticd {

inline constexpr double hertz_young = 10e3, hertz_poisson = 0.3, hertz_radius = 10e-3;

struct HertzResult {
  double force = 0;        // on the sphere [N]
  double element = 0;      // size at the contact, in contact radii
  int dropped = 0;         // contacts beyond capacity
  double penetration = 0;  // [m]
};
HertzResult hertz_by_bodies(double depth, int cells);

}  // namespace hapticd
