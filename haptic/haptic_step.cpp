#include "haptic/haptic_step.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "haptic/problem_check.h"

namespace hapticd {
namespace {

constexpr double most_parts = 12;          // of the way from where a problem was made
constexpr double shortest_part = 0.25e-3;  // of a tick [s]
constexpr double least_of_margin = 0.2;    // samples that near are rows whatever moves
constexpr double share_of_near = 0.5;      // of what a resumed solve that is not usable moves the force by
constexpr double lost_contact = 0.1e-3;     // [m]
constexpr double shortest_tick = 0.5e-3;   // [s]; states that come closer together know no speed

WatchdogInput watchdog_input(const HapticInput& input, const CondensedProblem* problem) noexcept {
  return {.now_ns = input.now_ns,
          .presence = input.presence,
          .taken = input.taken,
          .sample = input.sample,
          .has_problem = problem && problem->step > 0,
          .problem_published_ns = problem ? problem->published_ns : 0};
}

ForceSample answer_to(const Verdict& verdict, const CondensedProblem* problem, HapticState& s) noexcept {
  ForceSample answer;
  answer.sequence = ++s.tick;
  answer.status = verdict.status;
  answer.answers = verdict.answers;
  if (s.watchdog.has_sample) {
    answer.echo_sequence = s.watchdog.sample.sequence;
    answer.echo_client_time_ns = s.watchdog.sample.client_time_ns;
  }
  answer.step = problem ? problem->step : 0;
  answer.solver_caps = s.caps;
  answer.state_age_ns = verdict.state_age_ns;
  answer.problem_age_ns = verdict.problem_age_ns;
  return answer;
}

// The last good wrench, never more: held, then fading.
Wrench held_wrench(HapticState& s, double period) noexcept {
  constexpr double hold = 10e-3, fade = 90e-3;
  s.unusable_for += period;
  return std::clamp(1 - (s.unusable_for - hold) / fade, 0.0, 1.0) * s.good;
}

// A poisoned problem would be no contact, or any force. Looked at whole when it is new.
bool is_sound_problem(const CondensedProblem& problem, HapticState& s) noexcept {
  if (problem.step != s.sound_step) {
    if (!is_sound(problem)) return false;
    s.sound_step = problem.step;
  }
  for (int n = 0; n < problem.nodes; ++n)
    if (!problem.x_free[static_cast<std::size_t>(n)].allFinite()) return false;
  return true;
}

const Wrench nan_wrench{Vec3::Constant(std::numeric_limits<double>::quiet_NaN()), Vec3::Zero()};

// The last problem pressed on for the first `part` of this tick, as far as the instrument then was on its way
// to X. False where nothing is remembered.
bool solve_until_publication(double part, double period, const Pose& X, const Instrument& instrument,
                             ContactOptions contact, HapticState& s) noexcept {
  const CondensedProblem* before = at_part_of_tick(part, s.patch);
  if (!before) return false;
  if (contact.deadline.bounded())
    contact.deadline.reserve_ns += std::max<std::int64_t>(0, contact.deadline.left() / 2);
  const Pose there = displaced(s.X, part / period * difference(X, s.X));
  const ContactSolution solution =
      solve_contact(*before, instrument, there, part, contact, s.contact, s.scratch);
  if (solution.status == SolveStatus::solved || solution.residual <= contact.usable_residual)
    remember(s.scratch.x, s.patch);
  return true;
}

Wrench contact_wrench(const CondensedProblem& problem, const Instrument& instrument,
                      const DeviceSettings& device, const HapticOptions& options, const HapticInput& input,
                      double period, HapticState& s, ForceSample& answer) noexcept {
  // Said as NaN, so that it takes the one way that latches.
  if (!is_sound_problem(problem, s)) return nan_wrench;
  const Pose X = to_scene(device, s.watchdog.sample.pose);
  ContactOptions contact = options.contact;
  contact.deadline = input.deadline;
  contact.usable_residual = options.usable_residual;
  // Tissue gives way from the instant in which elements went; until then what was there before is pressed on.
  double T = period;
  if (problem.topology_changed && problem.step != s.patch.step) {
    const double age = 1e-9 * static_cast<double>(input.now_ns - problem.published_ns);
    const double part = period - std::max(age, shortest_part);
    if (part >= shortest_part && solve_until_publication(part, period, X, instrument, contact, s)) T -= part;
  }
  // Rows for what some ticks like this one can reach; more where that turns out to be too few.
  if (std::isfinite(options.ticks_ahead))
    contact.activation_distance = std::clamp(options.ticks_ahead * difference(X, s.X).head<3>().norm(),
                                             least_of_margin * contact.margin, contact.margin);
  s.X = X;
  const CondensedProblem& now =
      at_tick(problem, options.viscous, T < period ? T : std::max(T, shortest_tick), s.patch);
  // A problem that the instrument has outrun is met where it was made, and on the way from there.
  if (problem.step != s.step && s.contact.memory.count == 0 && contact.margin > 0) {
    const Vec6 way = difference(X, problem.X_ref);
    const double parts = std::min(way.head<3>().norm() / contact.margin, most_parts);
    for (int p = 0; parts > 1 && p < parts; ++p)
      solve_contact(now, instrument, displaced(problem.X_ref, p / parts * way), T, contact, s.contact,
                    s.scratch);
  }
  const ContactSolution& solution = s.solution =
      solve_contact(now, instrument, X, T, contact, s.contact, s.scratch);
  s.solved = true;
  answer.contacts = static_cast<std::uint32_t>(solution.contacts);
  answer.active = static_cast<std::uint32_t>(solution.active);
  answer.dropped = static_cast<std::uint32_t>(solution.dropped);
  answer.residual = solution.residual;
  answer.penetration = solution.penetration;
  if (solution.lost > lost_contact) answer.status |= status_contact_lost;
  // Its wrench is zero then.
  if (solution.status == SolveStatus::not_finite) return nan_wrench;
  if (solution.dropped + problem.dropped_samples > 0) answer.status |= status_contacts_dropped;
  if (solution.status != SolveStatus::solved) {
    answer.status |= status_solver_cap;
    answer.solver_caps = ++s.caps;
  }
  const bool usable = solution.status == SolveStatus::solved || solution.residual <= options.usable_residual;
  // A poor iterate may be anything.
  if (!usable && !solution.near) return held_wrench(s, period);
  remember(s.scratch.x, s.patch);
  s.unusable_for = 0;
  const Wrench fresh{force_to_device(device, solution.wrench.head<3>()),
                     torque_to_device(device, solution.wrench.tail<3>())};
  s.good = usable ? fresh : s.good + share_of_near * (fresh - s.good);
  return s.good;
}

// Nothing is rendered, so nothing may be remembered that a later arming would feel.
ForceSample zero_output(ForceSample answer, HapticState& s) noexcept {
  s.contact.memory.count = 0;
  s.contact.coupling_offset.setZero();
  s.contact.frozen_step = 0;
  s.patch.step = 0;
  s.blend.left = 0;
  s.passivity = {};
  s.render = Render::zero;
  s.rendered = s.sent = s.good = {};
  s.controlled = Vec3::Zero();
  s.unusable_for = 0;
  answer.force.setZero();
  answer.torque.setZero();
  return answer;
}

// Silence, once the force that was sent has gone to zero within the slew limit. Until then it is not
// `disarmed`.
ForceSample release(ForceSample answer, const DeviceSettings& device, double period,
                    HapticState& s) noexcept {
  bool slew = false;
  const Wrench left = slew_limited(device, s.sent, {}, period, slew);
  const PassivityState passivity = s.passivity;
  answer = zero_output(answer, s);
  if (!slew || device.max_force_rate <= 0 || device.max_force <= 0) return answer;
  s.passivity = passivity;
  s.sent = left;
  answer.force = left.force;
  answer.torque = left.torque;
  answer.energy = passivity.energy;
  answer.status =
      (answer.status & ~std::uint32_t{status_disarmed}) | status_ramping_down | status_slew_limited;
  return answer;
}

ForceSample not_finite(ForceSample answer, HapticState& s) noexcept {
  latch_not_finite(s.watchdog);
  answer.status |= status_not_finite | status_latched | status_disarmed;
  return zero_output(answer, s);
}

}  // namespace

ForceSample haptic_step(const CondensedProblem* problem, const Instrument& instrument,
                        const DeviceSettings& device, const HapticOptions& options, const HapticInput& input,
                        HapticState& s) noexcept {
  const double period =
      1e-9 * static_cast<double>(input.period_ns > 0 ? input.period_ns : options.watchdog.period_ns);
  s.solved = false;

  // read
  const Verdict verdict = watch(options.watchdog, device, watchdog_input(input, problem), s.watchdog);
  ForceSample answer = answer_to(verdict, problem, s);
  if (verdict.render == Render::zero) return zero_output(answer, s);
  observe(s.passivity, s.watchdog.sample.pose, s.sent);
  if (verdict.render == Render::release) return release(answer, device, period, s);

  // compute
  Wrench wrench = s.rendered;
  if (verdict.render == Render::contact)
    wrench = contact_wrench(*problem, instrument, device, options, input, period, s, answer);
  else if (verdict.render == Render::damp)
    wrench = {-device.damping * s.watchdog.velocity, Vec3::Zero()};
  if (!is_finite(wrench)) return not_finite(answer, s);

  // filter
  if (verdict.render != Render::hold) {
    const bool removal =
        verdict.render == Render::contact && problem->step != s.step && problem->topology_changed;
    const bool change = s.render != Render::zero && s.render != verdict.render;
    if ((removal || change) && options.blend_time > 0) start_blend(s.blend, s.rendered);
    if (s.blend.left > 0) answer.status |= status_blending;
    wrench = blended(s.blend, wrench, period, options.blend_time);
  }
  s.step = problem->step;
  s.render = verdict.render;
  s.rendered = wrench;
  wrench = verdict.gain * wrench;
  s.controlled = Vec3::Zero();
  if (options.passivity_control)
    s.controlled = passivity_force(s.passivity, s.watchdog.velocity, device.damping, period);
  wrench.force += s.controlled;

  // limit
  bool saturation = false, slew = false;
  wrench = saturated(device, wrench, saturation);
  wrench = slew_limited(device, s.sent, wrench, period, slew);
  if (saturation) answer.status |= status_saturated;
  if (slew) answer.status |= status_slew_limited;

  // check finite
  if (!is_finite(wrench)) return not_finite(answer, s);

  // answer
  s.sent = wrench;
  answer.force = wrench.force;
  answer.torque = wrench.torque;
  answer.energy = s.passivity.energy;
  return answer;
}

InstrumentInput instrument_input(const DeviceSettings& device, const WatchdogLimits& limits,
                                 const WatchdogState& state, std::int64_t now_ns) noexcept {
  InstrumentInput in;
  in.present = state.has_sample && now_ns - state.sample.received_ns < limits.ramp_after_ns;
  in.X = to_scene(device, state.sample.pose);
  in.buttons = in.present ? state.sample.buttons : 0;
  in.received_ns = state.sample.received_ns;
  in.sequence = state.sample.sequence;
  return in;
}

}  // namespace hapticd
