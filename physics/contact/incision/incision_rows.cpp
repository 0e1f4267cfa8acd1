#include "physics/contact/incision/incision_rows.h"

#include <algorithm>

namespace hapticd {
namespace {

constexpr double least_offset = 1e-9;  // below it the shaft is in the middle: any direction [m]

bool is_below(const Incision& ring, const Pose& X) noexcept {
  return ring.stiffness > 0 && (ring.at - X.p).dot(ring.axis) > 0;
}

}  // namespace

int count_incisions(Instruments instruments, const InstrumentPoses& X_lin) noexcept {
  int count = 0;
  for (int i = 0; i < instruments.count(); ++i)
    count += X_lin.present[i] && is_below(instruments[i].incision, X_lin[i]);
  return count;
}

void add_incisions(Instruments instruments, const InstrumentPoses& X_free, const InstrumentPoses& X_lin,
                   const ContactMemory& memory, ContactRows& rows) noexcept {
  for (int i = 0; i < instruments.count(); ++i) {
    const Incision& ring = instruments[i].incision;
    if (!X_lin.present[i] || !is_below(ring, X_lin[i])) continue;
    const Pose& X = X_lin[i];
    const Vec3 shaft = X.q * Vec3::UnitZ();
    const Vec3 s = X.p + std::max(0.0, shaft.dot(ring.at - X.p)) * shaft, d = s - ring.at;
    const double offset = d.norm();
    const Vec3 normal = offset > least_offset ? Vec3(d / offset) : shaft.unitOrthogonal();
    const ContactMemory::Entry* known = memory.find(incision_id(i), i);

    ContactRow& row = rows.row[rows.contacts++];
    row.sample = row.other = row.edge = -1;
    row.incision = true;
    row.instrument = i;
    row.primitive = 0;
    row.id = incision_id(i);
    row.friction = ring.friction;
    row.limit = no_limit;
    row.compliance = 1 / ring.stiffness;
    row.advance = std::max(ring.slack, known ? std::min(known->advance, offset) : offset);
    row.gap = row.advance - offset;
    row.frame = contact_frame(normal);
    const double radius = std::max(0.0, -gap_at(instruments[i], X, s).distance);
    row.arm = s + radius * normal - X.p;
    // Where it did not press the contact may have been on another side of the shaft.
    const bool pressed = known && !known->lambda.isZero(0);
    row.anchor = pressed ? known->anchor : X.q.conjugate() * row.arm;
    row.other_anchor = pressed ? known->other_anchor : Vec3(X.p + row.arm);
    const Vec6 shift = difference(X_free[i], X);
    row.delta_free = row.frame.transpose() * (row.other_anchor - X.to_world(row.anchor));
    row.delta_free[0] = row.gap;
    row.delta_free -= row.frame.transpose() * Vec3(shift.head<3>() + shift.tail<3>().cross(row.arm));
  }
}

Vec3 ring_at_rest(const ContactRow& row, const Pose& X, const Vec3& lambda) noexcept {
  return X.p + row.arm - row.compliance * (row.frame.rightCols<2>() * lambda.tail<2>());
}

}  // namespace hapticd
