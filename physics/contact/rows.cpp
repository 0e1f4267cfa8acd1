// Outer side: 0.2 is a tolerance of 11° past tangent. It keeps the samples around a sharp edge, whose face is
// turned away although the instrument is on it, and lets no ghost contact come from inside. The normal is
// that of the linearisation (missed_contact.h): by the published one a flap that turns over within a tick is
// let through. An instrument that tissue presses from outside cannot come from inside: then the face does not
// matter: what is turned away is the far side of a flap thinner than the instrument, of a fold or of a
// crushed element.
//
// Missing compliance: a contact whose tissue is stiffer than a thousandth of the coupling (a fixed obstacle,
// tissue next to fixed nodes) gets W_ii += max(0, 1e-3 mean B_ii − mean G_ii) · I, means of the diagonal
// (without friction G's normal entry). The coupling's part has rank ≤ 6, and rigid friction is hyperstatic
// without it.
//
// Rows for all primitives: with the nearest one alone the solve would move a sample from one that is held to
// one that is not, and back in the next tick. Candidates that do not overlap and have no row could not have
// pressed.
#include "physics/contact/rows.h"

#include <algorithm>
#include <cmath>

#include "physics/contact/candidates/contact_selection.h"
#include "physics/contact/candidates/samples_in_reach.h"
#include "physics/contact/contact_pairs.h"
#include "physics/contact/cutting/edge_rows.h"
#include "physics/contact/delassus.h"
#include "physics/contact/delassus_columns.h"
#include "physics/contact/incision/incision_rows.h"
#include "physics/contact/instrument_pairs.h"
#include "physics/contact/missed_contact.h"
#include "physics/contact/placed_instruments.h"

namespace hapticd {
namespace {

// The samples' rows that there are, asked about in their own order.
class RowsBefore {
 public:
  RowsBefore(const ContactRows& rows, bool any) noexcept {
    while (any && count_ < rows.contacts && rows.row[count_].sample >= 0) {
      row_[count_] = {rows.row[count_].sample, rows.row[count_].instrument, rows.row[count_].primitive};
      ++count_;
    }
  }
  bool have(int sample, int instrument, int primitive) noexcept {
    const Key asked{sample, instrument, primitive};
    while (next_ < count_ && row_[next_] < asked) ++next_;
    return next_ < count_ && row_[next_] == asked;
  }

 private:
  using Key = std::array<int, 3>;
  std::array<Key, max_contacts> row_;
  int count_ = 0, next_ = 0;
};

// Samples and primitives that become rows, by sample index (which is by id), then instrument and primitive;
// each row with all three, gap and, in its frame's first column, normal. Counts the overlapping ones that did
// not fit.
//
// After a solve, `reached`: rows come, none goes, or a sample that was let through, got a row and then
// pressed would be let through again. With friction `most_new` at a time: a solve that throws tissue lets
// hundreds through, of which the deepest hold the others. Where they do not fit, those go that the solve says
// stay open, and gaps at its end decide.
void select(const CondensedProblem& problem, const PlacedInstruments& placed, const InstrumentPoses& X_lin,
            const PatchPositions& x, const EachInstrument<bool>& outside, double margin,
            const Reached* reached, int capacity, SamplesInReach& in_reach, double slack,
            ContactRows& rows) noexcept {
  const EachInstrument<Vec6> moved = reached ? difference(reached->X, X_lin) : EachInstrument<Vec6>();
  const double reach = reached ? std::max(margin, problem.alarm_distance) : margin;
  std::array<ContactCandidate, max_patch_samples> candidate;
  const auto take = [&rows](int i, int sample, int instrument, const Gap& gap) {
    rows.row[i].sample = sample;
    rows.row[i].instrument = instrument;
    rows.row[i].primitive = gap.primitive;
    rows.row[i].other = rows.row[i].edge = -1;
    rows.row[i].incision = false;
    rows.row[i].limit = no_limit;
    rows.row[i].gap = gap.distance;
    rows.row[i].frame.col(0) = gap.normal;
  };
  RowsBefore before(rows, reached != nullptr);
  int count = 0, dropped = 0, others = 0;
  Vec3 outward = Vec3::Zero();   // of the face …
  std::int64_t outward_of = -1;  // … that it was made for
  for (const SamplesInReach::Entry& at : in_reach.at(problem, placed, X_lin, x, reach, slack)) {
    const int k = at.sample;
    const bool obstacle = problem.sample[k].node[0] < 0;
    const Vec3 s = sample_position(problem, x, k);
    for (int i = 0; i < placed.count(); ++i) {
      if (!placed.at(i) || !at.near(i)) continue;
      for (const Gap& gap : GapsInReach(*placed.at(i), s, reach)) {
        const double end =
            reached ? gap_reached(problem, k, s, gap, X_lin[i], moved[i], reached->x) : gap.distance;
        const bool near = gap.distance < margin || before.have(k, i, gap.primitive);
        if (!near && !(end < 0)) continue;
        const bool known = near || !(problem.sample[k].friction > 0);
        if (obstacle || outward_of != at.face) outward = sample_outward(problem, x, k);
        outward_of = at.face;
        if (!may_press(problem, k, gap, placed.at(i)->radius(static_cast<std::size_t>(gap.primitive)),
                       outward, outside[i]))
          continue;
        // Only where samples have several primitives within reach.
        if (count == max_patch_samples) {
          count /= 2;
          dropped += keep_deepest(candidate, count);
        }
        if (count < capacity) take(count, k, i, gap);
        candidate[count++] = {
            end, k, at.face, static_cast<std::int16_t>(gap.primitive), static_cast<std::int16_t>(i), known};
        others += !known;
      }
    }
  }
  rows.dropped = dropped;
  rows.contacts = count;
  const int most_new = reached ? reached->most_new : count;
  if (count <= capacity && others <= most_new) return;
  const auto all = [&] { return std::span(candidate.data(), static_cast<std::size_t>(count)); };
  if (others > most_new) count = select_new(all(), most_new);
  if (reached && count > capacity) {
    const auto stays_open = [](const ContactCandidate& c) { return c.gap > same_gap; };
    count = static_cast<int>(std::remove_if(all().begin(), all().end(), stays_open) - all().begin());
  }
  if (count > capacity) {
    rows.dropped += select_contacts(all(), capacity);
    count = capacity;
  }
  rows.contacts = count;
  for (int i = 0; i < count; ++i) {
    const ContactCandidate& c = candidate[i];
    take(i, c.sample, c.instrument,
         placed.at(c.instrument)
             ->gap(static_cast<std::size_t>(c.primitive), sample_position(problem, x, c.sample)));
  }
}

// Rows of instruments that touch, behind those of tissue. Of two that are held rigidly nothing could give
// way.
void add_pairs(const CondensedProblem& problem, const InstrumentPairs& pairs, const InstrumentPoses& X_lin,
               const EachInstrument<Vec6>& K_inv_diag, ContactRows& rows) noexcept {
  for (const InstrumentPair& pair : pairs) {
    if (K_inv_diag[pair.instrument].isZero(0) && K_inv_diag[pair.other].isZero(0)) continue;
    ContactRow& row = rows.row[rows.contacts++];
    row.sample = -1;
    row.instrument = pair.instrument;
    row.primitive = pair.primitive;
    row.other = pair.other;
    row.edge = -1;
    row.incision = false;
    row.limit = no_limit;
    row.id = pair.id;
    row.gap = pair.gap.distance;
    row.friction = problem.instrument_friction;
    row.frame.col(0) = pair.gap.normal;
    row.arm = pair.gap.on_a - X_lin[pair.instrument].p;
    row.other_arm = pair.gap.on_b - X_lin[pair.other].p;
  }
}

// J d of one contact, in its frame: minus the displacement of the instrument's point at the contact, plus
// that of the other's.
Vec3 coupled(const ContactRow& row, const EachInstrument<Vec6>& d) noexcept {
  const auto moved = [&](int i, const Vec3& arm) { return Vec3(d[i].head<3>() + d[i].tail<3>().cross(arm)); };
  const Vec3 own = moved(row.instrument, row.arm);
  if (row.other < 0) return -row.frame.transpose() * own;
  return row.frame.transpose() * (moved(row.other, row.other_arm) - own);
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

void build_rows(const CondensedProblem& problem, Instruments instruments, const InstrumentPoses& X_free,
                const InstrumentPoses& X_lin, const PatchPositions& x_lin,
                const EachInstrument<Vec6>& K_inv_diag, const ContactMemory& memory, double margin,
                ContactRows& rows, const Reached* reached, PartTimes* times, double period,
                EitherColumns* columns, SamplesInReach* in_reach) noexcept {
  const Within rows_part(times, ContactPart::rows);
  SamplesInReach of_this_call;
  const InstrumentPairs pairs(instruments, X_lin, problem.alarm_distance);
  select(problem, PlacedInstruments(instruments, X_lin), X_lin, x_lin, memory.outside, margin, reached,
         max_contacts - pairs.count() - count_edges(problem, X_lin) - count_incisions(instruments, X_lin),
         in_reach ? *in_reach : of_this_call, in_reach ? reach_slack * problem.alarm_distance : 0, rows);
  add_edges(problem, X_free, X_lin, x_lin, memory, period, rows);
  add_pairs(problem, pairs, X_lin, K_inv_diag, rows);
  add_incisions(instruments, X_free, X_lin, memory, rows);
  rows.rows_per_contact = 1;
  for (int i = 0; i < rows.contacts; ++i) {
    ContactRow& row = rows.row[i];
    if (row.sample >= 0) row.friction = problem.sample[row.sample].friction;
    if (row.friction > 0 || row.edge >= 0) rows.rows_per_contact = 3;
  }

  const EachInstrument<Vec6> shift = difference(X_free, X_lin);
  int from = 0;
  for (int i = 0; i < rows.contacts; ++i) {
    ContactRow& row = rows.row[i];
    if (row.edge >= 0 || row.incision) {
      if (rows.rows_per_contact == 1) row.delta_free.tail<2>().setZero();
      set_q(rows, i, row.delta_free);
      continue;
    }
    const Pose& X = X_lin[row.instrument];
    const Vec3 normal = row.frame.col(0);
    row.frame = contact_frame(normal);
    Vec3 s = Vec3::Zero(), s_free = s;
    if (row.other < 0) {
      s = sample_position(problem, x_lin, row.sample);
      s_free = sample_position(problem, problem.x_free, row.sample);
      row.id = problem.sample[row.sample].id;
      row.arm = s - X.p;
    }
    const ContactMemory::Entry* known = memory.find(row.id, row.instrument, row.primitive, from);
    if (!known && row.other < 0) known = memory.find(row.id, row.instrument);
    if (row.other < 0) {
      row.anchor = known ? known->anchor : X.to_local(s);
    } else {
      const Pose& Y = X_lin[row.other];
      s = Y.p + row.other_arm;
      row.anchor = known ? known->anchor : X.to_local(X.p + row.arm);
      row.other_anchor = known ? known->other_anchor : Y.to_local(s);
      s_free = Y.to_world(row.other_anchor);
    }
    row.delta_free = row.frame.transpose() * (s_free - X.to_world(row.anchor));
    row.delta_free[0] = row.other < 0 ? row.gap + normal.dot(s_free - s) : row.gap;
    row.delta_free += coupled(row, shift);
    if (rows.rows_per_contact == 1) row.delta_free.tail<2>().setZero();
    set_q(rows, i, row.delta_free);
  }
  const Within delassus(times, ContactPart::delassus);
  if (columns && rows.edges == 0 && rows.rows_per_contact == 3)
    columns->whole.begin(problem, K_inv_diag, rows);
  else if (columns && rows.edges == 0)
    columns->normal.begin(problem, K_inv_diag, rows);
  else
    assemble_delassus(problem, K_inv_diag, rows);
}

void shift_rows(const CondensedProblem& problem, const InstrumentPoses& X_frozen,
                const InstrumentPoses& X_free, const ContactMemory& memory, ContactRows& rows) noexcept {
  const EachInstrument<Vec6> shift = difference(X_free, X_frozen);
  for (int i = 0; i < rows.contacts; ++i) {
    ContactRow& row = rows.row[i];
    if (row.edge >= 0) {
      const EdgeSample& edge = problem.edge[row.edge];
      const double advance = total_advance(edge, memory.find(edge.id, edge.instrument));
      row.delta_free[0] += advance - row.advance;
      row.gap += advance - row.advance;
      row.advance = advance;
    } else if (rows.rows_per_contact == 3) {
      if (const ContactMemory::Entry* known = memory.find(row.id, row.instrument, row.primitive)) {
        row.anchor = known->anchor;
        row.other_anchor = known->other_anchor;
      }
      const Vec3 s_free = row.incision    ? row.other_anchor
                          : row.other < 0 ? sample_position(problem, problem.x_free, row.sample)
                                          : X_frozen[row.other].to_world(row.other_anchor);
      const Vec3 slip = row.frame.transpose() * (s_free - X_frozen[row.instrument].to_world(row.anchor));
      row.delta_free.tail<2>() = slip.tail<2>();
    }
    set_q(rows, i, row.delta_free + coupled(row, shift));
  }
}

EachInstrument<Vec6> wrench_on_instruments(const ContactRows& rows, std::span<const double> lambda) noexcept {
  EachInstrument<Vec6> wrench;
  for (int i = 0; i < rows.contacts; ++i) {
    const ContactRow& row = rows.row[i];
    Vec3 force = Vec3::Zero();
    for (int c = 0; c < rows.rows_per_contact; ++c)
      force += lambda[rows.rows_per_contact * i + c] * row.frame.col(c);
    wrench[row.instrument].head<3>() -= force;
    wrench[row.instrument].tail<3>() -= row.arm.cross(force);
    if (row.other < 0) continue;
    wrench[row.other].head<3>() += force;
    wrench[row.other].tail<3>() += row.other_arm.cross(force);
  }
  return wrench;
}

}  // namespace hapticd
