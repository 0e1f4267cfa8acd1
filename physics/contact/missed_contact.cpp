#include "physics/contact/missed_contact.h"

#include <algorithm>

#include "physics/contact/contact_pairs.h"

namespace hapticd {

bool violates_inactive_contact(const CondensedProblem& problem, const Instrument& instrument,
                               const Pose& X_lin, const PatchPositions& x_lin, double held, double margin,
                               const Reached& end) noexcept {
  const Vec6 moved = difference(end.X, X_lin);
  const auto instrument_at = [&](const Vec3& s) {
    return moved.head<3>().norm() + moved.tail<3>().norm() * (s - X_lin.p).norm();
  };
  const auto obstacle = [&](int k) { return problem.sample[k].node[0] < 0; };
  double farthest = 0;
  for (int n = 0; n < problem.nodes; ++n)
    farthest = std::max(farthest, (end.x[n] - x_lin[n]).norm() + instrument_at(x_lin[n]));
  if (held < margin)
    for (int k = 0; k < problem.samples; ++k)
      if (obstacle(k)) farthest = std::max(farthest, instrument_at(problem.sample[k].free));
  if (!(farthest > (held < margin ? held : 2 * margin))) return false;

  const PlacedInstrument placed(instrument, X_lin);
  for (int k = 0; k < problem.samples; ++k) {
    const double reach = obstacle(k) ? margin : std::max(margin, problem.alarm_distance);
    const Vec3 s = sample_position(problem, x_lin, k);
    for (const Gap& gap : GapsInReach(placed, s, reach))
      if (gap.distance >= held && gap.normal.dot(problem.sample[k].outward) < facing_away &&
          gap_reached(problem, k, s, gap, X_lin, moved, end.x) < (gap.distance < margin ? 0 : -margin))
        return true;
  }
  return false;
}

}  // namespace hapticd
