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

// A row that presses ends at a gap of zero, to rounding below it too: that is no miss.
bool has_row(const ContactRows& rows, int sample, int instrument, int primitive) noexcept {
  const auto last = rows.row.begin() + rows.contacts;
  return std::any_of(rows.row.begin(), last, [&](const ContactRow& row) {
    return row.sample == sample && row.instrument == instrument && row.primitive == primitive;
  });
}

// How far nodes move from one to the other at most [m].
double farthest_moved(const CondensedProblem& problem, const PatchPositions& from,
                      const PatchPositions& to) noexcept {
  double square = 0;
  for (int n = 0; n < problem.nodes; ++n) square = std::max(square, (to[n] - from[n]).squaredNorm());
  return std::sqrt(square);
}

// … and an instrument that moves so, at any of them [m].
double farthest_moved(const CondensedProblem& problem, const Pose& X, const Vec6& moved,
                      const PatchPositions& x, bool obstacles) noexcept {
  const double turn = moved.tail<3>().norm();
  double square = 0;
  for (int n = 0; turn > 0 && n < problem.nodes; ++n) square = std::max(square, (x[n] - X.p).squaredNorm());
  for (int k = 0; obstacles && turn > 0 && k < problem.samples; ++k)
    if (problem.sample[k].node[0] < 0)
      square = std::max(square, (problem.sample[k].free - X.p).squaredNorm());
  return moved.head<3>().norm() + turn * std::sqrt(square);
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
                               const Reached& end, SamplesInReach& in_reach) noexcept {
  const EachInstrument<Vec6> moved = difference(end.X, X_lin);
  EachInstrument<double> farthest;  // by which a gap may change; zero: of one that is not looked at
  const double tissue = farthest_moved(problem, x_lin, end.x);
  double most = 0;
  for (int i = 0; i < instruments.count(); ++i) {
    if (!X_lin.present[i]) continue;
    const double by = tissue + farthest_moved(problem, X_lin[i], moved[i], x_lin, held < margin);
    if (!(by > (held < margin ? held : 2 * margin))) continue;
    farthest[i] = by;
    most = std::max(most, by);
  }
  if (most == 0) return false;

  // A gap that is larger than by what it may change stays open.
  const PlacedInstruments placed(instruments, X_lin);
  const double reach = std::min(std::max(margin, problem.alarm_distance), most * (1 + same_gap));
  for (const SamplesInReach::Entry& at :
       in_reach.at(problem, placed, X_lin, x_lin, reach, reach_slack * problem.alarm_distance)) {
    const int k = at.sample;
    const Vec3 s = sample_position(problem, x_lin, k);
    const double of_sample = problem.sample[k].node[0] < 0 ? std::min(reach, margin) : reach;
    for (int i = 0; i < instruments.count(); ++i) {
      if (farthest[i] == 0 || !at.near(i)) continue;
      for (const Gap& gap : GapsInReach(*placed.at(i), s, of_sample))
        if (gap.distance >= held &&
            gap_reached(problem, k, s, gap, X_lin[i], moved[i], end.x) <
                (gap.distance < margin ? 0 : -margin) &&
            may_press(problem, k, gap, placed.at(i)->radius(static_cast<std::size_t>(gap.primitive)),
                      sample_outward(problem, x_lin, k), outside[i]) &&
            !has_row(rows, k, i, gap.primitive))
          return true;
    }
  }
  return false;
}

bool is_outside(const CondensedProblem& problem, int instrument, bool before, const ContactRows& rows,
                std::span<const double> lambda, const PatchPositions& x_end, double lost) noexcept {
  if (lost > (before ? 2 : 0.5) * shallow * problem.alarm_distance) return false;
  if (before) return true;
  for (int i = 0; i < rows.contacts; ++i) {
    const ContactRow& row = rows.row[i];
    if (row.instrument != instrument || row.sample < 0 || !(lambda[rows.rows_per_contact * i] > 0)) continue;
    if (row.frame.col(0).dot(sample_outward(problem, x_end, row.sample)) < facing_away) return true;
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
