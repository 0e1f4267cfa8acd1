#include "haptic/contact_capture.h"

namespace hapticd {

void ContactCaptures::after(const CondensedProblem& problem, const HapticState& state,
                            const HapticOptions& options) noexcept {
  constexpr std::uint64_t ticks_between = 20;
  const double period = 1e-9 * static_cast<double>(options.watchdog.period_ns);
  ++solves_;
  // A tick that had a removal in it may have been solved in two parts.
  if (problem.topology_changed && state.patch.step > 0 && state.patch.period < 0.9 * period) return;
  const SolveStatus status = state.solution.status;
  const bool capped = status != SolveStatus::solved && status != SolveStatus::not_finite;
  if (!capped && (every_ == 0 || solves_ % every_ != 0)) return;
  if (last_ > 0 && state.tick - last_ < ticks_between) return;
  last_ = state.tick;
  ContactCapture& c = captures_->back();
  copy_in_use(problem, c.problem);
  fold_scale(c.problem);
  c.state = before_;
  c.X = state.X;
  c.period = period;
  c.margin = options.contact.margin;
  c.linearisations = options.contact.linearisations;
  c.tolerance = options.contact.coulomb.tolerance;
  c.status = capped ? SolveStatus::iteration_cap : SolveStatus::solved;
  c.residual = state.solution.residual;
  c.wrench = state.solution.wrench;
  captures_->publish();
}

}  // namespace hapticd
