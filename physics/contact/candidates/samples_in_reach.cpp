#include "physics/contact/candidates/samples_in_reach.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hapticd {
namespace {

bool same_face(const PatchSample& a, const PatchSample& b) noexcept {
  constexpr int index_bits = 12;  // of a sample's id; the face is above them
  return a.node[0] == b.node[0] && a.node[1] == b.node[1] && a.node[2] == b.node[2] &&
         (a.node[0] >= 0 || a.id >> index_bits == b.id >> index_bits);
}

// The instruments that some point of the sample's triangle may be so near to; all, of an obstacle.
std::uint32_t near_face(const PatchSample& s, const PlacedInstruments& placed, const PatchPositions& x,
                        double reach) noexcept {
  std::uint32_t of = 0;
  if (s.node[0] < 0) {
    for (int i = 0; i < placed.count(); ++i) of |= (placed.at(i) ? 1U : 0U) << i;
    return of;
  }
  const Vec3 &a = x[s.node[0]], &b = x[s.node[1]], &c = x[s.node[2]];
  const Vec3 centre = (a + b + c) / 3;
  const double radius = std::sqrt(
      std::max({(a - centre).squaredNorm(), (b - centre).squaredNorm(), (c - centre).squaredNorm()}));
  for (int i = 0; i < placed.count(); ++i)
    of |= (placed.at(i) && placed.at(i)->near(centre, reach + radius) ? 1U : 0U) << i;
  return of;
}

}  // namespace

void SamplesInReach::keep(std::uint64_t of_samples) noexcept {
  if (of_samples == 0 || of_samples != of_samples_) all_.radius = -1;
  of_samples_ = of_samples;
}

std::span<const SamplesInReach::Entry> SamplesInReach::at(const CondensedProblem& problem,
                                                          const PlacedInstruments& placed,
                                                          const InstrumentPoses& X, const PatchPositions& x,
                                                          double reach, double slack) noexcept {
  double asked = all_.radius >= 0 ? reach + moved(problem, X, x) : reach;
  if (!(all_.radius >= 0) || !(asked <= all_.radius)) {
    all_.radius = reach + slack;
    nearest_.radius = 0.5 * slack;
    X_ = X;
    std::copy_n(x.begin(), problem.nodes, x_.begin());
    look(problem, placed, x);
    asked = reach;
  }
  const List& list = asked <= nearest_.radius ? nearest_ : all_;
  return {list.entry.data(), static_cast<std::size_t>(list.count)};
}

// Infinite where another instrument is there than was; one that left takes nothing with it.
double SamplesInReach::moved(const CondensedProblem& problem, const InstrumentPoses& X,
                             const PatchPositions& x) const noexcept {
  double tissue = 0, instruments = 0;
  for (int n = 0; n < problem.nodes; ++n) tissue = std::max(tissue, (x[n] - x_[n]).squaredNorm());
  for (int i = 0; i < max_instruments; ++i) {
    if (!X.present[i]) continue;
    if (!X_.present[i]) return std::numeric_limits<double>::infinity();
    const Vec6 by = difference(X[i], X_[i]);
    const double way = by.head<3>().norm(), turn = by.tail<3>().norm();
    double farthest = 0;
    for (int n = 0; turn > 0 && n < problem.nodes; ++n)
      farthest = std::max(farthest, (x[n] - X[i].p).squaredNorm());
    farthest = std::max(std::sqrt(farthest), obstacle_ + way);
    instruments = std::max(instruments, turn > 0 ? way + turn * farthest : way);
  }
  return std::sqrt(tissue) + instruments;
}

void SamplesInReach::look(const CondensedProblem& problem, const PlacedInstruments& placed,
                          const PatchPositions& x) noexcept {
  all_.count = nearest_.count = 0;
  obstacle_ = 0;
  std::uint32_t face = 0, near = 0;
  for (int k = 0; k < problem.samples; ++k) {
    const PatchSample& sample = problem.sample[k];
    const bool next = k > 0 && !same_face(problem.sample[k - 1], sample);
    if (next) ++face;
    if (next || k == 0) near = near_face(sample, placed, x, all_.radius);
    const bool obstacle = sample.node[0] < 0;
    if (!obstacle && near == 0) continue;
    const Vec3 s = sample_position(problem, x, k);
    std::uint32_t of = 0, nearest_of = 0;
    for (int i = 0; i < placed.count(); ++i) {
      if (!(near >> i & 1U)) continue;
      if (obstacle) obstacle_ = std::max(obstacle_, (s - X_[i].p).norm());
      if (!placed.at(i)->near(s, all_.radius)) continue;
      of |= 1U << i;
      if (placed.at(i)->near(s, nearest_.radius)) nearest_of |= 1U << i;
    }
    if (of != 0) all_.entry[static_cast<std::size_t>(all_.count++)] = {k, face, of};
    if (nearest_of != 0) nearest_.entry[static_cast<std::size_t>(nearest_.count++)] = {k, face, nearest_of};
  }
}

}  // namespace hapticd
