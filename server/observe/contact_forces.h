// The contacts of a solve that press, as a person would draw them.
//
//   place s = p_instrument + arm,   force on the tissue F λ;   the instrument feels −Σ F λ
//
// Units: m, N; scene axes.
#pragma once

#include <vector>

#include "physics/contact/contact_solve.h"

namespace hapticd {

struct ContactForce {
  Vec3 place = Vec3::Zero();
  Vec3 force = Vec3::Zero();  // on the tissue
  double gap = 0;             // at the solve's last linearisation [m]
};

std::vector<ContactForce> contact_forces(const ContactScratch& scratch, const Pose& instrument);

}  // namespace hapticd
