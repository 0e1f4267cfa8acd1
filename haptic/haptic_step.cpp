#include "haptic/haptic_step.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "haptic/contact/problem_check.h"
#include "physics/contact/suction.h"

namespace hapticd {
namespace {
constexpr double most_parts = 12;          // of the way from where a problem was made
constexpr double shortest_part = 0.25e-3;  // of a tick [s]
constexpr double least_of_margin = 0.2;    // samples that near are rows whatever moves
constexpr double share_of_near = 0.5;      // of what a resumed solve that is not usable moves the force by
constexpr double lost_contact = 0.1e-3;    // [m]
constexpr double shortest_tick = 0.5e-3;   // [s]; states that come closer together know no speed

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

// What the last good wrenches are still worth: held, then fading.
double share_held(double unusable_for) noexcept {
  constexpr double hold = 10e-3, fade = 90e-3;
  return std::clamp(1 - (unusable_for - hold) / fade, 0.0, 1.0);
}

bool is_usable(const ContactSolution& solution, const HapticOptions& options) noexcept {
  return solution.status == SolveStatus::solved || solution.residual <= options.usable_residual;
}

// Where those of X were before; who was not there, where it is.
InstrumentPoses on_the_way_from(const InstrumentPoses& before, const InstrumentPoses& X) noexcept {
  InstrumentPoses from = X;
  for (int i = 0; i < max_instruments; ++i)
    if (X.present[i] && before.present[i]) from[i] = before[i];
  return from;
}

bool all_known(const InstrumentPoses& before, const InstrumentPoses& X) noexcept {
  for (int i = 0; i < max_instruments; ++i)
    if (X.present[i] && !before.present[i]) return false;
  return true;
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

// What the pumps draw with, in the tick's problem, by where the last solve left patch and tips.
void draw(Instruments instruments, const InstrumentPoses& X, double period, HapticState& s) noexcept {
  const InstrumentPoses next = start_coupling(s.patch.problem, X, period, s.contact.coupling_offset).X_start;
  InstrumentPoses from = next;
  for (int i = 0; i < instruments.count(); ++i)
    if (s.placed.present[i]) from[i] = s.placed[i];
  std::copy_n(s.patch.before.begin(), s.patch.problem.nodes, s.patch.problem.x_now.begin());
  EachInstrument<double> vacuum;
  for (int i = 0; i < instruments.count(); ++i) vacuum[i] = s.device[i].vacuum;
  const EachInstrument<double> occlusion =
      apply_suction(instruments, from, next, s.patch.before, vacuum, s.patch.problem);
  for (int i = 0; i < instruments.count(); ++i) s.device[i].occlusion = occlusion[i];
}

// The last problem pressed on for the first `part` of this tick, as far as the instruments then were on their
// way to X. False where nothing is remembered.
bool solve_until_publication(double part, double period, const InstrumentPoses& X, Instruments instruments,
                             ContactOptions contact, HapticState& s) noexcept {
  const CondensedProblem* before = at_part_of_tick(part, s.patch);
  if (!before) return false;
  if (contact.deadline.bounded())
    contact.deadline.reserve_ns += std::max<std::int64_t>(0, contact.deadline.left() / 2);
  const InstrumentPoses from = on_the_way_from(s.X, X),
                        there = displaced(from, difference(X, from), part / period);
  if (any_port(instruments)) draw(instruments, there, part, s);
  const ContactSolution solution =
      solve_contact(*before, instruments, there, part, contact, s.contact, s.scratch);
  if (solution.status == SolveStatus::solved || solution.residual <= contact.usable_residual)
    remember(s.scratch.x, s.patch);
  return true;
}

// False: the problem, or what came out, is no number.
bool solve_tick(const CondensedProblem& problem, Instruments instruments, const InstrumentPoses& X,
                const HapticOptions& options, const HapticInput& input, double period,
                HapticState& s) noexcept {
  if (!is_sound_problem(problem, s)) return false;
  ContactOptions contact = options.contact;
  contact.deadline = input.deadline;
  contact.usable_residual = options.usable_residual;
  // Tissue gives way from the instant in which elements went; until then what was there before is pressed on.
  double T = period;
  if (problem.topology_changed && problem.step != s.patch.step) {
    const double age = 1e-9 * static_cast<double>(input.now_ns - problem.published_ns);
    const double part = period - std::max(age, shortest_part);
    if (part >= shortest_part && solve_until_publication(part, period, X, instruments, contact, s)) T -= part;
  }
  // Rows for what some ticks like this one can reach; more where that turns out to be too few.
  if (std::isfinite(options.ticks_ahead) && all_known(s.X, X))
    contact.activation_distance = std::clamp(options.ticks_ahead * longest(difference(X, s.X)),
                                             least_of_margin * contact.margin, contact.margin);
  s.X = X;
  ViscousOptions viscous = options.viscous;
  viscous.always = any_port(instruments);
  const CondensedProblem& now =
      at_tick(problem, viscous, T < period ? T : std::max(T, shortest_tick), s.patch);
  if (&now == &s.patch.problem && any_port(instruments)) draw(instruments, X, T, s);
  // A problem that an instrument has outrun is met where it was made, and on the way from there.
  if (problem.step != s.step && s.contact.memory.count == 0 && contact.margin > 0) {
    InstrumentPoses from = X;
    for (int i = 0; i < max_instruments; ++i)
      if (X.present[i]) from[i] = problem.instrument[i].X_ref;
    const EachInstrument<Vec6> way = difference(X, from);
    const double parts = std::min(longest(way) / contact.margin, most_parts);
    if (parts > 1) contact.parts = parts;
    for (int p = 0; parts > 1 && p < parts; ++p)
      solve_contact(now, instruments, displaced(from, way, p / parts), T, contact, s.contact, s.scratch);
  }
  s.solution = solve_contact(now, instruments, X, T, contact, s.contact, s.scratch);
  s.solved = true;
  s.placed = is_usable(s.solution, options) ? s.solution.instrument : InstrumentPoses();
  return s.solution.status != SolveStatus::not_finite;
}

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
  answer.penetration = solution.penetration;
  if (solution.lost > lost_contact) answer.status |= status_contact_lost;
  if (solution.dropped + problem.dropped_samples > 0) answer.status |= status_contacts_dropped;
  if (solution.status != SolveStatus::solved) answer.status |= status_solver_cap;
  answer.solver_caps = s.caps;
  DeviceState& d = s.device[i];
  // A poor iterate may be anything.
  if (s.unusable_for > 0) return share_held(s.unusable_for) * d.good;
  const Vec6 felt = solution.wrench[i] - withheld(i, verdict, s.scratch);
  const Wrench fresh = wrench_on_device(device, d.watchdog.sample.pose, felt);
  d.good = is_usable(solution, options) ? fresh : d.good + share_of_near * (fresh - d.good);
  return d.good;
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

void forget_contact(HapticState& s) noexcept {
  s.contact.memory.count = 0;
  s.contact.memory.outside = {};
  s.contact.coupling_offset = {};
  s.contact.frozen_step = 0;
  s.placed = {};
  s.patch.step = 0;
  s.unusable_for = 0;
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

// What a device's wrench goes through on its way to the hand. changed: the problem, or who is in contact.
ForceSample rendered(Wrench wrench, ForceSample answer, const Verdict& verdict, bool changed,
                     const DeviceSettings& device, const HapticOptions& options, double period,
                     DeviceState& d) noexcept {
  // filter
  if (verdict.render != Render::hold) {
    const bool change = changed || (d.render != Render::zero && d.render != verdict.render);
    if (change && options.blend_time > 0) start_blend(d.blend, d.rendered);
    if (d.blend.left > 0) answer.status |= status_blending;
    wrench = blended(d.blend, wrench, period, options.blend_time);
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
  const bool removal = problem && problem->step != s.step && problem->topology_changed;
  if (contact) {
    finite = solve_tick(*problem, instruments, X, options, input, period, s);
    if (finite && s.solution.status != SolveStatus::solved) ++s.caps;
    if (finite && !is_usable(s.solution, options) && !s.solution.near) {
      s.unusable_for += period;
    } else if (finite) {
      remember(s.scratch.x, s.patch);
      s.unusable_for = 0;
    }
    // Who was armed in the middle of the tissue presses as soon as a problem reaches there.
    changed = count > 1 && solved_before &&
              (before.present.value != X.present.value || (ramping_up && problem->step != s.step));
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
      wrench = {-device.damping * d.watchdog.velocity, Vec3::Zero()};
    // As far as the other's own force has risen.
    if (render == Render::contact && device.ghost && X.present[device.ghost->of])
      wrench.force += verdict[device.ghost->of].gain * ghost_force(device, X[i].p, X[device.ghost->of].p);
    if (!is_finite(wrench)) {
      answer[i] = not_finite(answer[i], d);
      continue;
    }
    answer[i] = rendered(wrench, answer[i], verdict[i], render == Render::contact && (removal || changed),
                         device, options, period, d);
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
