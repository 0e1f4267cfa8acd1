// The fronts of the cuts that a blade makes: one material point for each sample of its edge.
//
//   on the surface: where the line from the sample along d enters the tissue, found again in each step
//   in the tissue:  X ← X + F⁻¹ d a, where the contact solve advanced it by a
//
// A front in the tissue stays where it is however far the blade withdraws along d, and while its device is
// silent; it is given up where the blade has moved aside by more than its sample is wide, where its
// tetrahedron went, where it left the tissue, and where a device comes back farther on than `reach`. A sample
// that is inside tissue without a front (it came there at once, or from aside) has its front where it is.
// Units: m; rest shape for `cut_to`. Errors: none. Source: DESIGN §11.
#pragma once

#include <cstdint>
#include <vector>

#include "physics/contact/instruments.h"
#include "physics/simulation/body.h"
#include "physics/simulation/cutting/material_point.h"

namespace hapticd {

struct CutFront {
  int body = -1;             // −1: nothing is ahead of the sample
  MaterialPoint point;       // of that body
  bool in_tissue = false;    // it has advanced …
  bool begun = false;        // … and the mesh was cut for it
  bool left = false;         // it came out of the tissue again …
  bool burst = false;        // … and the sample has not been outside since
  double advance = 0;        // since the cut began [m]
  Vec3 cut_to;               // the mesh is cut up to here
  std::uint32_t number = 0;  // a new one for each cut: forces and advances of the last are not its own
};

// Of one instrument.
class CutFronts {
 public:
  explicit CutFronts(const Blade& blade) : front_(blade.sample.size()) {}

  // For the blade at X, among the bodies that can be cut. reach: how far ahead, and back, the surface is
  // looked for [m].
  void find(const Bodies& bodies, const Blade& blade, const Pose& X, double reach);

  // Front k moves by `by` along d, in world axes [m]. Returns how far it went in the rest shape.
  double advance(const Bodies& bodies, int k, const Vec3& d, double by);

  // After a cut or a removal of this body.
  void follow(const Bodies& bodies, int body);

  // The device is silent.
  void rest() { rested_ = true; }

  const Vec3& along() const { return along_; }  // the edge's direction in world axes, when last found

  const std::vector<CutFront>& all() const { return front_; }
  std::vector<CutFront>& all() { return front_; }

 private:
  static void give_up(CutFront& front);
  bool stays(const Bodies& bodies, const CutFront& front, double width, const Vec3& edge, const Vec3& d,
             double reach) const;
  void find_inside(const Bodies& bodies, const Blade& blade, const Pose& X);

  std::vector<CutFront> front_;
  Vec3 along_ = Vec3::UnitX();
  bool rested_ = false;
};

}  // namespace hapticd
