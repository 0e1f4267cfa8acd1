// What charts of the step press: a lens alone, and a tip that travels over its anterior face.
//
//   p(s) = (r(s) cos φ, r(s) sin φ, z_surface + radius − depth),   r = around + aside sin(s/5 mm),
//   φ = s / 1.2 mm + turned,   s: way
//
// so the tip always comes to other tissue, at `speed`. The surface is the lens's at rest. Lenses are the
// cataract scene's (1k) and those of config/scenes/lens_large (100k is made there by `mesh.sh 100k`); all but
// the mesh is the scene lens_5k.
// Units: SI. Errors: InputError for a missing mesh.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "physics/simulation/world.h"
#include "server/scene/scene.h"

namespace hapticd {

struct TipSettings {
  double speed = 3e-3;  // [m/s]
  double depth = 0.3e-3;
  double around = 1.2e-3, aside = 0.8e-3;
  double turned = 0;  // [rad]
};

// alarm_distance and sample_spacing as asked for: they decide how large patch and contact are.
Scene lens_under_tip(const std::string& lens, double alarm_distance, double sample_spacing);

class TravellingTip {
 public:
  TravellingTip(const Scene& scene, const TipSettings& settings);

  Pose at(double t) const;

 private:
  double surface(double x, double y) const;

  TipSettings settings_;
  double radius_;
  std::vector<std::array<Vec3, 3>> faces_;  // that look up
};

}  // namespace hapticd
