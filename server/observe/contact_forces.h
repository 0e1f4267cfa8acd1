// The contacts of a solve that press, as a person would draw them.
//
//   place s = p_instrument + arm,   force on the tissue F λ;   the instrument feels −Σ F λ; of two that touch, at the other
//
// Units: m, N; scene axes.
#pragma once

#include <cstdint>
#include <vector>

#include "physics/contact/contact_solve.h"

namespace hapticd {

inline constexpr std::uint8_t pressed_tissue = 255;  // in SceneUpdate.pressing

struct ContactForce {
  Vec3 place = Vec3::Zero();
  Vec3 force = Vec3::Zero();  // on the tissue
  double gap = 0;             // at the solve's last linearisation [m]
  int instrument = 0;         // that presses
  int other = -1;             // the instrument that is pressed in place of tissue; -1: none
};

std::vector<ContactForce> contact_forces(const ContactScratch& scratch, const InstrumentPoses& instrument);

}  // namespace hapticd
