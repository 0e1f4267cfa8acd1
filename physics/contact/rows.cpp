// Outer side: 0.2 is a tolerance of 11° past tangent. It keeps the samples around a sharp edge, whose face is turned
// away although the instrument is on it, and lets no ghost contact come from inside.
//
// Missing compliance: a contact whose tissue is stiffer than a thousandth of the coupling (a fixed obstacle, tissue
// next to fixed nodes) gets W_ii += max(0, 1e-3 mean B_ii − mean G_ii) · I, means of the diagonal (without friction
// G's normal entry). The coupling's part has rank ≤ 6, and rigid friction is hyperstatic without it.
//
// Rows for all primitives: with the nearest one alone the solve would move a sample from one that is held to one that
// is not, and back in the next tick. Candidates that do not overlap and have no row could not have pressed.
#include "physics/contact/rows.h"

#include <algorithm>
#include <cmath>

#include "physics/contact/contact_pairs.h"
#include "physics/contact/contact_selection.h"
#include "physics/contact/delassus.h"
#include "physics/contact/missed_contact.h"
#include "physics/contact/placed_instrument.h"

namespace hapticd {
namespace {

bool same_face(const PatchSample& a, const PatchSample& b) noexcept {
  constexpr int index_bits = 12;  // of a sample's id; the face is above them
  return a.node == b.node && (a.node[0] >= 0 || a.id >> index_bits == b.id >> index_bits);
}

// False only where no point of the sample's triangle is within reach; a fixed obstacle's are not known.
bool face_near(const PatchSample& s, const PlacedInstrument& instrument, const PatchPositions& x,
               double reach) noexcept {
  if (s.node[0] < 0) return true;
  const Vec3 &a = x[s.node[0]], &b = x[s.node[1]], &c = x[s.node[2]];
  const Vec3 centre = (a + b + c) / 3;
  const double radius = std::sqrt(
      std::max({(a - centre).squaredNorm(), (b - centre).squaredNorm(), (c - centre).squaredNorm()}));
  return instrument.near(centre, reach + radius);
}

// Samples and primitives that become rows, by sample index (which is by id), then primitive; each row with
// both, gap and, in its frame's first column, normal. Counts the overlapping ones that did not fit.
void select(const CondensedProblem& problem, const PlacedInstrument& instrument, const Pose& X_lin,
            const PatchPositions& x, double margin, const Reached* reached, ContactRows& rows) noexcept {
  const Vec6 moved = reached ? difference(reached->X, X_lin) : Vec6(Vec6::Zero());
  const double reach = reached ? std::max(margin, problem.alarm_distance) : margin;
  std::array<ContactCandidate, max_patch_samples> candidate;
  const auto take = [&rows](int i, int sample, const Gap& gap) {
    rows.row[i].sample = sample;
    rows.row[i].primitive = gap.primitive;
    rows.row[i].gap = gap.distance;
    rows.row[i].frame.col(0) = gap.normal;
  };
  int count = 0, dropped = 0;
  std::uint32_t face = 0;
  bool near = true;
  for (int k = 0; k < problem.samples; ++k) {
    const PatchSample& sample = problem.sample[k];
    const bool next = k > 0 && !same_face(problem.sample[k - 1], sample);
    if (next) ++face;
    if (next || k == 0) near = face_near(sample, instrument, x, reach);
    if (!near) continue;
    const Vec3 s = sample_position(problem, x, k);
    for (const Gap& gap : GapsInReach(instrument, s, reach)) {
      if (!(gap.normal.dot(sample.outward) < facing_away)) continue;
      if (!(gap.distance < margin) && !(gap_reached(problem, k, s, gap, X_lin, moved, reached->x) < 0))
        continue;
      // Only where samples have several primitives within reach.
      if (count == max_patch_samples) {
        count /= 2;
        dropped += keep_deepest(candidate, count);
      }
      if (count < max_contacts) take(count, k, gap);
      candidate[count++] = {gap.distance, k, face, gap.primitive};
    }
  }
  rows.contacts = std::min(count, max_contacts);
  rows.dropped = dropped;
  if (count <= max_contacts) return;
  rows.dropped += select_contacts({candidate.data(), static_cast<std::size_t>(count)}, max_contacts);
  for (int i = 0; i < max_contacts; ++i)
    take(i, candidate[i].sample,
         instrument.gap(static_cast<std::size_t>(candidate[i].primitive),
                        sample_position(problem, x, candidate[i].sample)));
}

// J d of one contact, in its frame: minus the displacement of the instrument's point at the contact.
Vec3 coupled(const ContactRow& row, const Vec6& d) noexcept {
  return -row.frame.transpose() * (d.head<3>() + d.tail<3>().cross(row.arm));
}

void set_q(ContactRows& rows, int i, const Vec3& delta) noexcept {
  const int first = rows.rows_per_contact * i;
  for (int c = 0; c < rows.rows_per_contact; ++c) rows.q_storage[first + c] = delta[c];
}

}  // namespace

Vec3 sample_position(const CondensedProblem& problem, const PatchPositions& x, int sample) noexcept {
  const PatchSample& s = problem.sample[sample];
  if (s.node[0] < 0) return s.free;
  return s.weight[0] * x[s.node[0]] + s.weight[1] * x[s.node[1]] + s.weight[2] * x[s.node[2]];
}

Mat3 contact_frame(const Vec3& n) noexcept {
  const double sign = std::copysign(1.0, n.z());
  const double a = -1.0 / (sign + n.z()), b = n.x() * n.y() * a;
  Mat3 F;
  F.col(0) = n;
  F.col(1) = Vec3(1.0 + sign * n.x() * n.x() * a, sign * b, -sign * n.x());
  F.col(2) = Vec3(b, sign + n.y() * n.y() * a, -n.y());
  return F;
}

void build_rows(const CondensedProblem& problem, const Instrument& instrument, const Pose& X_free,
                const Pose& X_lin, const PatchPositions& x_lin, const Vec6& K_inv_diag,
                const ContactMemory& memory, double margin, ContactRows& rows, const Reached* reached,
                PartTimes* times) noexcept {
  const Within rows_part(times, ContactPart::rows);
  select(problem, PlacedInstrument(instrument, X_lin), X_lin, x_lin, margin, reached, rows);
  rows.rows_per_contact = 1;
  for (int i = 0; i < rows.contacts; ++i)
    if (problem.sample[rows.row[i].sample].friction > 0) rows.rows_per_contact = 3;

  const Vec6 shift = difference(X_free, X_lin);
  for (int i = 0; i < rows.contacts; ++i) {
    ContactRow& row = rows.row[i];
    const int k = row.sample;
    const Vec3 s = sample_position(problem, x_lin, k);
    const Vec3 s_free = sample_position(problem, problem.x_free, k);
    const Vec3 normal = row.frame.col(0);
    row.id = problem.sample[k].id;
    row.frame = contact_frame(normal);
    row.arm = s - X_lin.p;
    row.friction = problem.sample[k].friction;
    const ContactMemory::Entry* known = memory.find(row.id, row.primitive);
    if (!known) known = memory.find(row.id);
    row.anchor = known ? known->anchor : X_lin.to_local(s);
    row.delta_free = row.frame.transpose() * (s_free - X_lin.to_world(row.anchor));
    row.delta_free[0] = row.gap + normal.dot(s_free - s);
    row.delta_free += coupled(row, shift);
    if (rows.rows_per_contact == 1) row.delta_free.tail<2>().setZero();
    set_q(rows, i, row.delta_free);
  }
  const Within delassus(times, ContactPart::delassus);
  assemble_delassus(problem, K_inv_diag, rows);
}

void shift_rows(const CondensedProblem& problem, const Pose& X_frozen, const Pose& X_free,
                const ContactMemory& memory, ContactRows& rows) noexcept {
  const Vec6 shift = difference(X_free, X_frozen);
  for (int i = 0; i < rows.contacts; ++i) {
    ContactRow& row = rows.row[i];
    if (rows.rows_per_contact == 3) {
      if (const ContactMemory::Entry* known = memory.find(row.id, row.primitive)) row.anchor = known->anchor;
      const Vec3 s_free = sample_position(problem, problem.x_free, row.sample);
      const Vec3 slip = row.frame.transpose() * (s_free - X_frozen.to_world(row.anchor));
      row.delta_free.tail<2>() = slip.tail<2>();
    }
    set_q(rows, i, row.delta_free + coupled(row, shift));
  }
}

Vec6 wrench_on_instrument(const ContactRows& rows, std::span<const double> lambda) noexcept {
  Vec6 wrench = Vec6::Zero();
  for (int i = 0; i < rows.contacts; ++i) {
    const ContactRow& row = rows.row[i];
    Vec3 force = Vec3::Zero();
    for (int c = 0; c < rows.rows_per_contact; ++c)
      force += lambda[rows.rows_per_contact * i + c] * row.frame.col(c);
    wrench.head<3>() -= force;
    wrench.tail<3>() -= row.arm.cross(force);
  }
  return wrench;
}

}  // namespace hapticd
