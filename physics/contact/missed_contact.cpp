#include "physics/contact/missed_contact.h"

#include <algorithm>

#include "physics/contact/contact_pairs.h"
#include "physics/contact/distance/primitive_distance.h"

namespace hapticd {

Vec3 sample_outward(const CondensedProblem& problem, const PatchPositions& x, int sample) noexcept {
  const PatchSample& s = problem.sample[sample];
  if (s.node[0] < 0) return s.outward;
  const Vec3 &a = x[s.node[0]], &b = x[s.node[1]], &c = x[s.node[2]];
  const Vec3 area = (b - a).cross(c - a);
  const double size = area.norm();
  return size > 0 ? Vec3(area / size) : s.outward;
}

namespace {

// A row that presses ends at a gap of zero, to rounding below it too. Without friction, where a solve costs
// little, that counts as missed all the same: more held poses settle so (HeldPose.*).
bool has_row(const ContactRows& rows, int sample, int instrument, int primitive) noexcept {
  const auto last = rows.row.begin() + rows.contacts;
  return std::any_of(rows.row.begin(), last, [&](const ContactRow& row) {
    return row.sample == sample && row.instrument == instrument && row.primitive == primitive;
  });
}

bool violates(const CondensedProblem& problem, Instruments instruments, int i, const Pose& X_lin,
              const Vec6& moved, const PatchPositions& x_lin, double held, double margin, bool outside,
              const ContactRows& rows, const PatchPositions& x_end) noexcept {
  const auto instrument_at = [&](const Vec3& s) {
    return moved.head<3>().norm() + moved.tail<3>().norm() * (s - X_lin.p).norm();
  };
  const auto obstacle = [&](int k) { return problem.sample[k].node[0] < 0; };
  double farthest = 0;
  for (int n = 0; n < problem.nodes; ++n)
    farthest = std::max(farthest, (x_end[n] - x_lin[n]).norm() + instrument_at(x_lin[n]));
  if (held < margin)
    for (int k = 0; k < problem.samples; ++k)
      if (obstacle(k)) farthest = std::max(farthest, instrument_at(problem.sample[k].free));
  if (!(farthest > (held < margin ? held : 2 * margin))) return false;

  const PlacedInstrument placed(instruments[i], X_lin);
  for (int k = 0; k < problem.samples; ++k) {
    const double reach = obstacle(k) ? margin : std::max(margin, problem.alarm_distance);
    const Vec3 s = sample_position(problem, x_lin, k);
    for (const Gap& gap : GapsInReach(placed, s, reach))
      if (gap.distance >= held &&
          gap_reached(problem, k, s, gap, X_lin, moved, x_end) < (gap.distance < margin ? 0 : -margin) &&
          may_press(problem, k, gap, sample_outward(problem, x_lin, k), outside) &&
          !(rows.rows_per_contact > 1 && has_row(rows, k, i, gap.primitive)))
        return true;
  }
  return false;
}

bool meets_tissue(const CondensedProblem& problem, const PlacedInstrument& placed) noexcept {
  for (int k = 0; k < problem.samples; ++k)
    if (placed.near(sample_position(problem, problem.x_now, k), problem.alarm_distance)) return true;
  return false;
}

bool meets(const Instrument& a, const Pose& X_a, const Instrument& b, const Pose& X_b,
           double reach) noexcept {
  for (const Primitive& of_a : a.primitives)
    for (const Primitive& of_b : b.primitives)
      if (near(of_a, X_a, of_b, X_b, reach)) return true;
  return false;
}

}  // namespace

bool violates_inactive_contact(const CondensedProblem& problem, Instruments instruments,
                               const InstrumentPoses& X_lin, const PatchPositions& x_lin, double held,
                               double margin, const EachInstrument<bool>& outside, const ContactRows& rows,
                               const Reached& end) noexcept {
  const EachInstrument<Vec6> moved = difference(end.X, X_lin);
  for (int i = 0; i < instruments.count(); ++i)
    if (X_lin.present[i] &&
        violates(problem, instruments, i, X_lin[i], moved[i], x_lin, held, margin, outside[i], rows, end.x))
      return true;
  return false;
}

bool is_outside(const CondensedProblem& problem, int instrument, bool before, const ContactRows& rows,
                std::span<const double> lambda, const PatchPositions& x_end, double lost) noexcept {
  if (lost > (before ? shallow * problem.alarm_distance : 0)) return false;
  for (int i = 0; i < rows.contacts; ++i) {
    const ContactRow& row = rows.row[i];
    if (row.instrument != instrument || row.sample < 0 || !(lambda[rows.rows_per_contact * i] > 0)) continue;
    if (before || row.frame.col(0).dot(sample_outward(problem, x_end, row.sample)) < facing_away) return true;
  }
  return false;
}

double deepest_overlap(const CondensedProblem& problem, const PlacedInstrument& placed, int instrument,
                       std::span<const SamplesInReach::Entry> in_reach, const ContactRows& rows,
                       const PatchPositions& x, double& lost) noexcept {
  double deepest = 0;
  int tissue = rows.contacts;
  while (tissue > 0 && rows.row[tissue - 1].sample < 0) --tissue;
  int row = 0;  // rows are by sample, then instrument, then primitive; those without a sample come last
  for (const SamplesInReach::Entry& at : in_reach) {
    if (!at.near(instrument)) continue;
    const int k = at.sample;
    const Vec3 s = sample_position(problem, x, k);
    const auto before = [&](const ContactRow& r) {
      return r.sample != k ? r.sample < k : r.instrument < instrument;
    };
    while (row < tissue && before(rows.row[row])) ++row;
    int end = row;
    while (end < tissue && rows.row[end].sample == k && rows.row[end].instrument == instrument) ++end;
    const bool all_held = end - row == static_cast<int>(placed.primitives());
    if (!placed.near(s, all_held ? -deepest : -lost)) continue;
    const double overlap = -placed.gap(s).distance;
    deepest = std::max(deepest, overlap);
    if (all_held) continue;
    // How deep it is in the primitives that it has rows for: one of them may imply the nearest's.
    double activation = -std::numeric_limits<double>::infinity();
    for (int i = row; i < end; ++i)
      activation =
          std::max(activation, -placed.gap(static_cast<std::size_t>(rows.row[i].primitive), s).distance);
    if (overlap > activation + same_gap) lost = std::max(lost, overlap);
  }
  return deepest;
}

double longest_in_reach(const CondensedProblem& problem, Instruments instruments, const InstrumentPoses& X,
                        const EachInstrument<Vec6>& way) noexcept {
  if (instruments.count() == 1) return longest(way);
  EachInstrument<Vec6> of_those;
  for (int i = 0; i < instruments.count(); ++i) {
    if (!X.present[i]) continue;
    bool in_reach = meets_tissue(problem, PlacedInstrument(instruments[i], X[i]));
    for (int j = 0; j < instruments.count() && !in_reach; ++j)
      in_reach =
          j != i && X.present[j] && meets(instruments[i], X[i], instruments[j], X[j], problem.alarm_distance);
    if (in_reach) of_those[i] = way[i];
  }
  return longest(of_those);
}

}  // namespace hapticd
