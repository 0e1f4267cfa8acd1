#include "server/observe/contact_forces.h"

namespace hapticd {

std::vector<ContactForce> contact_forces(const ContactScratch& scratch, const InstrumentPoses& instrument) {
  const ContactRows& rows = scratch.rows;
  std::vector<ContactForce> out;
  for (int i = 0; i < rows.contacts; ++i) {
    const ContactRow& row = rows.row[static_cast<std::size_t>(i)];
    Vec3 lambda = Vec3::Zero();
    for (int k = 0; k < rows.rows_per_contact; ++k)
      lambda[k] = scratch.lambda[static_cast<std::size_t>(rows.rows_per_contact * i + k)];
    if (lambda[0] > 0) out.push_back({instrument[row.instrument].p + row.arm, row.frame * lambda, row.gap, row.instrument, row.other});
  }
  return out;
}

}  // namespace hapticd
