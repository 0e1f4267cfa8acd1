#include "physics/contact/let_through.h"

#include <algorithm>

namespace hapticd {

bool lets_through(const CondensedProblem& problem, const Instrument& instrument, const Pose& X_lin,
                  const PatchPositions& x_lin, double margin, const Reached& end) noexcept {
  const Vec6 moved = difference(end.X, X_lin);
  double farthest = 0;
  for (int n = 0; n < problem.nodes; ++n)
    farthest = std::max(farthest, (end.x[n] - x_lin[n]).norm() + moved.head<3>().norm() +
                                      moved.tail<3>().norm() * (x_lin[n] - X_lin.p).norm());
  if (!(farthest > 2 * margin)) return false;

  const PlacedInstrument placed(instrument, X_lin);
  for (int k = 0; k < problem.samples; ++k) {
    if (problem.sample[k].node[0] < 0) continue;
    const Vec3 s = sample_position(problem, x_lin, k);
    if (!placed.near(s, problem.alarm_distance)) continue;
    const Gap gap = placed.gap(s);
    if (gap.distance >= margin && gap.distance < problem.alarm_distance &&
        gap.normal.dot(problem.sample[k].outward) < facing_away &&
        gap_reached(problem, k, s, gap, X_lin, moved, end.x) < -margin)
      return true;
  }
  return false;
}

}  // namespace hapticd
