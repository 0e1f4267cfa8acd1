#include "haptic/haptic_step.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "haptic/contact/tick_solve.h"
#include "physics/contact/suction.h"

namespace hapticd {
namespace {
constexpr double share_of_near = 0.5;    // of what a resumed solve that is not usable moves the force by
constexpr double lost_contact = 0.1e-3;  // [m]
constexpr double hold = 10e-3;           // where no solve serves, the last wrenches are held so long …
constexpr double fade = 90e-3;           // … and then fade [s]
constexpr double hold_thrown = 5e-3;     // … so long, where time ends solves that throw tissue [s]

WatchdogInput watchdog_input(const HapticInput& input, int i, const CondensedProblem* problem) noexcept {
  const DeviceInput& device = input.device[i];
  return {.now_ns = input.now_ns,
          .presence = device.presence,
          .taken = device.taken,
          .sample = device.sample,
          .has_problem = problem && problem->step > 0,
          .problem_published_ns = problem ? problem->published_ns : 0};
}

ForceSample answer_to(const Verdict& verdict, const CondensedProblem* problem, const HapticState& s,
                      const DeviceState& d) noexcept {
  ForceSample answer;
  answer.sequence = s.tick;
  answer.status = verdict.status;
  answer.answers = verdict.answers;
  if (d.watchdog.has_sample) {
    answer.echo_sequence = d.watchdog.sample.sequence;
    answer.echo_client_time_ns = d.watchdog.sample.client_time_ns;
  }
  answer.step = problem ? problem->step : 0;
  answer.solver_caps = s.caps;
  answer.state_age_ns = verdict.state_age_ns;
  answer.problem_age_ns = verdict.problem_age_ns;
  return answer;
}

// Whether this tick's solve is not gone on from. A poor iterate may be anything. And time may end one where
// it has thrown tissue into an instrument: a crumb gives way by 0.3 mm to a force that no residual shows.
// In a tick that begins anew the simulation has that tissue inside too, and it is felt.
bool is_poor(const HapticOptions& options, double period, const HapticState& s) noexcept {
  if (!is_usable(s.solution, options) && !s.solution.near) return true;
  const double deep = std::max(s.overlap, options.contact.too_deep);
  return options.contact.too_deep > 0 && s.solution.status != SolveStatus::solved && !s.any_astray() &&
         s.solution.penetration > deep && s.unusable_for + 0.5 * period < hold_thrown;
}

// What the last good wrenches are still worth: held, then fading.
double share_held(double unusable_for) noexcept {
  return std::clamp(1 - (unusable_for - hold) / fade, 0.0, 1.0);
}

const Wrench nan_wrench{Vec3::Constant(std::numeric_limits<double>::quiet_NaN()), Vec3::Zero()};

// Of the forces between instrument i and others, what those others' hands do not feel, being on their way in.
// A hand pushed by more than it pushes back would be given energy.
Vec6 withheld(int i, const EachInstrument<Verdict>& verdict, const ContactScratch& scratch) noexcept {
  Vec6 sum = Vec6::Zero();
  const ContactRows& rows = scratch.rows;
  for (int r = 0; r < rows.contacts; ++r) {
    const ContactRow& row = rows.row[r];
    if (row.other < 0 || (row.instrument != i && row.other != i)) continue;
    const bool first = row.instrument == i;
    const double share = 1 - verdict[first ? row.other : row.instrument].gain;
    if (share == 0) continue;
    Vec3 force = Vec3::Zero();
    for (int c = 0; c < rows.rows_per_contact; ++c)
      force += (first ? -share : share) * scratch.lambda[rows.rows_per_contact * r + c] * row.frame.col(c);
    sum.head<3>() += force;
    sum.tail<3>() += (first ? row.arm : row.other_arm).cross(force);
  }
  return sum;
}

// What the tick's solve says to one device; s.unusable_for: this tick's.
Wrench contact_wrench(const CondensedProblem& problem, int i, const EachInstrument<Verdict>& verdict,
                      const DeviceSettings& device, const HapticOptions& options, HapticState& s,
                      ForceSample& answer) noexcept {
  const ContactSolution& solution = s.solution;
  const int rows = s.scratch.rows.rows_per_contact;
  for (int r = 0; r < s.scratch.rows.contacts; ++r) {
    const ContactRow& row = s.scratch.rows.row[r];
    if (row.instrument != i && row.other != i) continue;
    ++answer.contacts;
    answer.active += s.scratch.lambda[rows * r] > 0;
  }
  answer.dropped = static_cast<std::uint32_t>(solution.dropped);
  answer.samples = static_cast<std::uint32_t>(problem.samples);
  answer.samples_dropped = static_cast<std::uint32_t>(problem.dropped_samples);
  answer.residual = solution.residual;
  answer.penetration = s.overlap;
  if (solution.lost > lost_contact || s.astray[i]) answer.status |= status_contact_lost;
  if (solution.dropped + problem.dropped_samples > 0) answer.status |= status_contacts_dropped;
  if (solution.status != SolveStatus::solved) answer.status |= status_solver_cap;
  answer.solver_caps = s.caps;
  DeviceState& d = s.device[i];
  if (s.unusable_for > 0) return share_held(s.unusable_for) * d.good;
  const Vec6 felt = solution.wrench[i] - withheld(i, verdict, s.scratch);
  const Wrench fresh = wrench_on_device(device, d.watchdog.sample.pose, felt);
  d.good = is_usable(solution, options) ? fresh : d.good + share_of_near * (fresh - d.good);
  return d.good;
}

// Of a problem that has grown old: −b v, and no more than contact last was, or a late step would be a blow to
// a hand that moves fast.
Vec3 damping_force(const DeviceSettings& device, const DeviceState& d) noexcept {
  const Vec3 force = -device.damping * d.watchdog.velocity;
  const double size = force.norm(), most = d.good.force.norm();
  return size > most ? Vec3(most / size * force) : force;
}

// Nothing is rendered, so nothing may be remembered that a later arming would feel.
ForceSample zero_output(ForceSample answer, DeviceState& d) noexcept {
  d.blend.left = 0;
  d.passivity = {};
  d.render = Render::zero;
  d.rendered = d.sent = d.good = {};
  d.controlled = Vec3::Zero();
  answer.force.setZero();
  answer.torque.setZero();
  return answer;
}

// Silence, once the force that was sent has gone to zero within the slew limit. Until then it is not
// `disarmed`.
ForceSample release(ForceSample answer, const DeviceSettings& device, double period,
                    DeviceState& d) noexcept {
  bool slew = false;
  const Wrench left = slew_limited(device, d.sent, {}, period, slew);
  const PassivityState passivity = d.passivity;
  answer = zero_output(answer, d);
  if (!slew || device.max_force_rate <= 0 || device.max_force <= 0) return answer;
  d.passivity = passivity;
  d.sent = left;
  answer.force = left.force;
  answer.torque = left.torque;
  answer.energy = passivity.energy;
  answer.status =
      (answer.status & ~std::uint32_t{status_disarmed}) | status_ramping_down | status_slew_limited;
  return answer;
}

ForceSample not_finite(ForceSample answer, DeviceState& d) noexcept {
  latch_not_finite(d.watchdog);
  answer.status |= status_not_finite | status_latched | status_disarmed;
  return zero_output(answer, d);
}

// The most that an instrument's pump has done on its hand since the last tick: vacuum · area · way, as the
// device has it [J].
double pumped_work(const Port& port, const DeviceState& d, const DeviceSettings& device) noexcept {
  if (d.vacuum <= 0 || !d.passivity.has_pose) return 0;
  const Vec3 way = d.watchdog.sample.pose.p - d.passivity.pose.p;
  return device.force_scale * d.vacuum * std::numbers::pi * port.radius * port.radius * way.norm();
}

// What a device's wrench goes through on its way to the hand. thinned: the problem is new, and tissue became
// less by degrees; changed: tissue went at once, or others are in contact.
ForceSample rendered(Wrench wrench, ForceSample answer, const Verdict& verdict, bool thinned, bool changed,
                     const DeviceSettings& device, const HapticOptions& options, double period,
                     DeviceState& d) noexcept {
  // filter
  if (verdict.render != Render::hold) {
    const bool change = changed || (d.render != Render::zero && d.render != verdict.render);
    const double time = change                                  ? options.blend_time
                        : thinned && d.render == verdict.render ? options.thinning_time
                                                                : 0;
    if (time > 0) start_blend(d.blend, d.rendered, time);
    if (d.blend.left > 0 && d.blend.time > options.thinning_time) answer.status |= status_blending;
    wrench = blended(d.blend, wrench, period);
  }
  d.render = verdict.render;
  d.rendered = wrench;
  wrench = verdict.gain * wrench;

  // limit
  bool saturation = false, slew = false;
  wrench = saturated(device, wrench, saturation);
  d.controlled = Vec3::Zero();
  if (options.passivity_control) {
    const Wrench allowed = passive(d.passivity, wrench, d.watchdog.velocity, device, period);
    d.controlled = allowed.force - wrench.force;
    wrench = saturated(device, allowed, saturation);
  }
  wrench = slew_limited(device, d.sent, wrench, period, slew);
  if (saturation) answer.status |= status_saturated;
  if (slew) answer.status |= status_slew_limited;

  // check finite
  if (!is_finite(wrench)) return not_finite(answer, d);

  // answer
  d.sent = wrench;
  answer.force = wrench.force;
  answer.torque = wrench.torque;
  answer.energy = d.passivity.energy;
  return answer;
}

}  // namespace

EachInstrument<ForceSample> haptic_step(const CondensedProblem* problem, Instruments instruments,
                                        std::span<const DeviceSettings> devices, const HapticOptions& options,
                                        const HapticInput& input, HapticState& s) noexcept {
  const double period =
      1e-9 * static_cast<double>(input.period_ns > 0 ? input.period_ns : options.watchdog.period_ns);
  const int count = static_cast<int>(devices.size());
  const InstrumentPoses before = s.X;
  const bool solved_before = s.solved;
  s.solved = false;
  ++s.tick;

  // read
  EachInstrument<Verdict> verdict;
  EachInstrument<ForceSample> answer;
  InstrumentPoses X;
  bool contact = false, ramping_up = false;
  for (int i = 0; i < count; ++i) {
    DeviceState& d = s.device[i];
    const DeviceSettings& device = devices[static_cast<std::size_t>(i)];
    verdict[i] = watch(options.watchdog, device, watchdog_input(input, i, problem), d.watchdog);
    answer[i] = answer_to(verdict[i], problem, s, d);
    X[i] = to_scene(device, d.watchdog.sample.pose);
    const Render render = verdict[i].render;
    X.present[i] = render == Render::contact || (verdict[i].status & status_holding && d.present);
    d.present = X.present[i];
    contact = contact || render == Render::contact;
    ramping_up = ramping_up || verdict[i].status & status_ramping_up;
    const bool on = X.present[i] && (d.watchdog.sample.buttons & pedal_aspiration) != 0;
    d.vacuum = pumped(instruments[i].port, d.vacuum, d.occlusion, on, period);
    d.occlusion = 0;  // until a solve says more
  }

  // compute
  bool finite = true, changed = false;
  const bool swapped = problem && problem->step != s.step, thinned = swapped && problem->thinned;
  // What goes by degrees is a tenth of itself by then: no more than what becomes less.
  const bool removal = swapped && problem->topology_changed && !thinned;
  if (contact) {
    finite = solve_tick(*problem, instruments, X, options, input, period, s);
    if (finite && s.solution.status != SolveStatus::solved) ++s.caps;
    if (finite && is_poor(options, period, s)) {
      s.unusable_for += period;  // force, tissue and instruments stay as they were
    } else if (finite) {
      s.overlap = s.solution.penetration;
      remember(s.scratch.x, s.patch);
      s.unusable_for = 0;
    }
    // Who was armed in the middle of the tissue presses as soon as a problem reaches there.
    changed = count > 1 && solved_before &&
              (before.present.value != X.present.value || (ramping_up && problem->step != s.step));
    changed = changed || s.any_astray();
  }
  bool renders = false;
  for (int i = 0; i < count; ++i) {
    DeviceState& d = s.device[i];
    const DeviceSettings& device = devices[static_cast<std::size_t>(i)];
    const Render render = verdict[i].render;
    if (render == Render::zero) {
      answer[i] = zero_output(answer[i], d);
      continue;
    }
    observe(d.passivity, d.watchdog.sample.pose, d.sent, period, pumped_work(instruments[i].port, d, device));
    if (render == Render::release) {
      answer[i] = release(answer[i], device, period, d);
      continue;
    }
    Wrench wrench = d.rendered;
    if (render == Render::contact)
      wrench = finite ? contact_wrench(*problem, i, verdict, device, options, s, answer[i]) : nan_wrench;
    else if (render == Render::damp)
      wrench = {damping_force(device, d), Vec3::Zero()};
    // As far as the other's own force has risen.
    if (render == Render::contact && device.ghost && X.present[device.ghost->of])
      wrench.force += verdict[device.ghost->of].gain * ghost_force(device, X[i].p, X[device.ghost->of].p);
    if (!is_finite(wrench)) {
      answer[i] = not_finite(answer[i], d);
      continue;
    }
    answer[i] = rendered(wrench, answer[i], verdict[i], thinned && render == Render::contact,
                         render == Render::contact && (removal || changed), device, options, period, d);
    renders = renders || d.render != Render::zero;
  }
  if (renders)
    s.step = problem->step;
  else
    forget_contact(s);
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
