// What seeded hands over the cataract scene's lens share: chance, places, and the shaft through the incision.
//
// Places are of the centre of the tip's sphere, in the scene's frame; surfaces are the lens's at rest
// (config/scenes/cataract: profile.geo, cornea.geo, make_trajectory.py). Units: m.
#pragma once

#include <cstdint>
#include <random>

#include "physics/types.h"

namespace hapticd {

// The same numbers on every machine, which the distributions of the standard library are not.
class Chance {
 public:
  explicit Chance(std::uint64_t seed) : random_(seed) {}
  double between(double low, double high) {
    return low + (high - low) * (static_cast<double>(random_() >> 11) * 0x1p-53);
  }
  bool happens(double probability) { return between(0, 1) < probability; }

 private:
  std::mt19937_64 random_;
};

// The tip's lowest point is `depth` below the anterior surface.
Vec3 over_lens(double x, double y, double depth);

// … and where it touches the posterior surface from within.
Vec3 on_posterior(double x, double y);

// The shaft's direction as the instrument's z, its x level: through the incision, or the scene two_hands's
// side port.
Quat through_incision(const Vec3& tip);
Quat through_side_port(const Vec3& tip);

}  // namespace hapticd
