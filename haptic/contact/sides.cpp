#include "haptic/contact/sides.h"

#include <algorithm>
#include <cmath>

#include "physics/contact/missed_contact.h"
#include "physics/contact/placed_instrument.h"

namespace hapticd {
namespace {

constexpr double apart = 0.25;  // of the places that are looked at on the way [alarm distances]
constexpr int most_places = 8;

// One that comes out again is at least twice as long as it is deep; of what ends inside, what is as far in.
double least_way(double reach) noexcept { return 2 * shallow * reach; }

bool leads_through(const PlacedInstrument& placed, const Vec3& from, const Vec3& to, double reach) noexcept {
  const double deep = shallow * reach, length = (to - from).norm();
  if (length < least_way(reach) || !placed.near(from, reach)) return false;
  const double limit = std::min(0.0, placed.gap(from).distance) - deep;
  const int places = static_cast<int>(std::min<double>(most_places, std::ceil(length / (apart * reach))));
  for (int i = 1; i <= places; ++i) {
    const Vec3 x = from + static_cast<double>(i) / places * (to - from);
    if (placed.near(x, 0) && placed.gap(x).distance < limit) return true;
  }
  return false;
}

}  // namespace

EachInstrument<bool> on_other_side(const CondensedProblem& problem, Instruments instruments,
                                   const InstrumentPoses& X_a, const PatchPositions& a,
                                   const InstrumentPoses& X_b, const PatchPositions& b) noexcept {
  EachInstrument<bool> other;
  for (int i = 0; i < instruments.count(); ++i) {
    if (!X_a.present[i] || !X_b.present[i]) continue;
    const PlacedInstrument placed(instruments[i], X_b[i]);
    const auto carried = [&](const Vec3& x) { return X_b[i].to_world(X_a[i].to_local(x)); };
    // A sample is between its nodes, and so is its way.
    double longest = 0;
    for (int n = 0; n < problem.nodes; ++n) longest = std::max(longest, (b[n] - carried(a[n])).norm());
    if (longest < least_way(problem.alarm_distance)) continue;
    for (int k = 0; k < problem.samples && !other[i]; ++k) {
      if (problem.sample[k].node[0] < 0) continue;
      const Vec3 from = carried(sample_position(problem, a, k));
      other[i] = leads_through(placed, from, sample_position(problem, b, k), problem.alarm_distance);
    }
  }
  return other;
}

}  // namespace hapticd
