#include "haptic/contact/tick_solve.h"

#include <algorithm>
#include <cmath>

#include "haptic/contact/problem_check.h"
#include "haptic/contact/sides.h"
#include "physics/contact/suction.h"

namespace hapticd {
namespace {
constexpr double lost_tissue = 0.1e-3;     // that no contact holds, inside an instrument by more [m]
constexpr double grip_time = 2e-3;         // time constant with which a port takes hold [s]
constexpr double most_parts = 12;          // of the way from where a problem was made
constexpr double catch_up_speed = 20e-3;   // at least, with which it makes up for being behind [m/s] …
constexpr double catch_up_time = 8e-3;     // … else of this time constant [s]
constexpr double turn_lever = 1e-3;        // by which a turn counts as a way [m]
constexpr double shortest_part = 0.25e-3;  // of a tick [s]
constexpr double least_of_margin = 0.2;    // samples that near are rows whatever moves
constexpr int most_new = 24;               // rows with friction that a repeated solve adds
constexpr double shortest_tick = 0.5e-3;   // [s]; states that come closer together know no speed

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

// A poisoned problem would be no contact, or any force. Looked at whole when it is new, if nobody has.
bool is_sound_problem(const CondensedProblem& problem, HapticState& s) noexcept {
  if (problem.step != s.sound_step) {
    if (!problem.known_sound && !is_sound(problem)) return false;
    s.sound_step = problem.step;
  }
  for (int n = 0; n < problem.nodes; ++n)
    if (!problem.x_free[static_cast<std::size_t>(n)].allFinite()) return false;
  return true;
}

// What the pumps draw with, in the tick's problem, by where the last solve left patch and tips.
void draw(Instruments instruments, const InstrumentPoses& X, double period, double share,
          HapticState& s) noexcept {
  const InstrumentPoses next = start_coupling(s.patch.problem, X, period, s.contact.coupling_offset).X_start;
  InstrumentPoses from = next;
  for (int i = 0; i < instruments.count(); ++i)
    if (s.placed.present[i]) from[i] = s.placed[i];
  std::copy_n(s.patch.before.begin(), s.patch.problem.nodes, s.patch.problem.x_now.begin());
  EachInstrument<double> vacuum;
  for (int i = 0; i < instruments.count(); ++i) vacuum[i] = s.device[i].vacuum;
  const EachInstrument<double> occlusion =
      apply_suction(instruments, from, next, s.patch.before, vacuum, s.patch.problem, &s.patch.grip, share);
  for (int i = 0; i < instruments.count(); ++i) s.device[i].occlusion = occlusion[i];
}

// How much more hold a port takes in such a time.
double taken_in(double period) noexcept { return period / (period + grip_time); }

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
  if (any_port(instruments)) draw(instruments, there, part, taken_in(part), s);
  const ContactSolution solution =
      solve_contact(*before, instruments, there, part, contact, s.contact, s.scratch);
  if (solution.status == SolveStatus::solved || solution.residual <= contact.usable_residual)
    remember(s.scratch.x, s.patch);
  return true;
}

// Where the problem was made.
InstrumentPoses made_at(const CondensedProblem& problem, const InstrumentPoses& X) noexcept {
  InstrumentPoses there = X;
  for (int i = 0; i < max_instruments; ++i)
    if (X.present[i]) there[i] = problem.instrument[i].X_ref;
  return there;
}

// About which instruments this loop, which has them placed, has tissue on another side than the problem.
EachInstrument<bool> astray(const CondensedProblem& published, const CondensedProblem& now,
                            Instruments instruments, const InstrumentPoses& X, const InstrumentPoses& placed,
                            const ContactMemory& memory) noexcept {
  if (published.renewal == Renewal::frozen) return {};
  PatchPositions x;
  displaced_patch(now, memory, x);
  return on_other_side(published, instruments, made_at(published, X), published.x_now, placed, x);
}

// Where this tick has the devices: nearer to where they are by a part of what the last one was behind.
InstrumentPoses catch_up(const InstrumentPoses& X, double period, EachInstrument<Vec6>& behind) noexcept {
  for (int i = 0; i < max_instruments; ++i) {
    Vec6& way = behind[i];
    if (!X.present[i]) way.setZero();
    if (way.isZero(0)) continue;
    const double length = way.head<3>().norm() + turn_lever * way.tail<3>().norm();
    way *= 1 - std::min(1.0, std::max(period / catch_up_time, catch_up_speed * period / length));
  }
  return displaced(X, behind, -1);
}

// The simulation's own contact is taken as it stands, with devices at the poses it is of: a solve that is
// solved already, in whatever time there is. It is a step of the simulation, and at rest: the way from there
// to X is nobody's speed, and the ticks that follow make it up. Without that contact (of a problem that came
// over a network) it begins from no forces, those astray from where the problem was made: with forces
// remembered of any, the patch would not begin there.
void begin_anew(const EachInstrument<bool>& astray, const CondensedProblem& problem, Instruments instruments,
                const InstrumentPoses& X, double tick, const ViscousOptions& viscous, ContactOptions contact,
                HapticState& s) noexcept {
  const double h = viscous.step > 0 ? viscous.step : tick;
  s.contact.memory = problem.known;
  for (int i = 0; i < max_instruments; ++i) s.contact.coupling_offset[i] = problem.instrument[i].offset;
  s.contact.resumed = 0;
  contact.parts = 1;
  s.patch.step = 0;
  s.placed = {};
  const CondensedProblem& now = at_tick(problem, viscous, h, s.patch);
  const InstrumentPoses made = made_at(problem, X);
  for (int i = 0; i < max_instruments; ++i)
    s.X[i] = astray[i] || problem.known.knows_tissue() ? made[i] : X[i];
  s.behind = difference(X, s.X);
  if (&now == &s.patch.problem && any_port(instruments)) draw(instruments, s.X, h, 1, s);
  s.solution = solve_contact(now, instruments, s.X, h, contact, s.contact, s.scratch);
}

}  // namespace

bool is_usable(const ContactSolution& solution, const HapticOptions& options) noexcept {
  return solution.status == SolveStatus::solved || solution.residual <= options.usable_residual;
}

bool solve_tick(const CondensedProblem& problem, Instruments instruments, const InstrumentPoses& X_device,
                const HapticOptions& options, const HapticInput& input, double period,
                HapticState& s) noexcept {
  if (!is_sound_problem(problem, s)) return false;
  ContactOptions contact = options.contact;
  contact.deadline = input.deadline;
  contact.usable_residual = options.usable_residual;
  contact.numbered = true;
  contact.most_new = most_new;
  const InstrumentPoses X = catch_up(X_device, period, s.behind);
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
  const double tick = T < period ? T : std::max(T, shortest_tick);
  s.astray = {};
  if (problem.step != s.step) {
    s.left_inside = 0;
    s.astray =
        astray(problem, at_tick(problem, viscous, tick, s.patch), instruments, X, s.placed, s.contact.memory);
  }
  const auto meet = [&]() -> const CondensedProblem& {
    const CondensedProblem& now = at_tick(problem, viscous, tick, s.patch);
    const bool draws = &now == &s.patch.problem && any_port(instruments);
    if (draws) draw(instruments, X, T, taken_in(T), s);
    // A problem that an instrument has outrun is met where it was made, and on the way from there.
    if (problem.step != s.step && !s.contact.memory.knows_tissue() && contact.margin > 0) {
      const InstrumentPoses from = made_at(problem, X);
      const EachInstrument<Vec6> way = difference(X, from);
      const double parts = std::min(longest(way) / contact.margin, most_parts);
      if (parts > 1) contact.parts = parts;
      for (int p = 0; parts > 1 && p < parts && !contact.deadline.passed(); ++p)
        solve_contact(now, instruments, displaced(from, way, p / parts), T, contact, s.contact, s.scratch);
    }
    s.solution = solve_contact(now, instruments, X, T, contact, s.contact, s.scratch);
    if (!draws || !let_go(now, instruments, s.patch.before, s.scratch.x, s.patch.grip) ||
        contact.deadline.passed())
      return now;
    at_tick(problem, viscous, tick, s.patch);
    draw(instruments, X, T, 0, s);
    s.solution = solve_contact(now, instruments, X, T, contact, s.contact, s.scratch);
    return now;
  };
  if (!s.any_astray()) {
    const CondensedProblem& now = meet();
    // What beginning anew did not free, once more would not.
    if (s.solution.lost > s.left_inside + lost_tissue && is_usable(s.solution, options) &&
        !contact.deadline.passed())
      s.astray = astray(problem, now, instruments, X, s.solution.instrument, s.contact.memory);
  }
  if (s.any_astray()) begin_anew(s.astray, problem, instruments, X_device, tick, viscous, contact, s);
  s.left_inside = s.any_astray() ? s.solution.lost : std::min(s.left_inside, s.solution.lost);
  s.solved = true;
  s.placed = is_usable(s.solution, options) ? s.solution.instrument : InstrumentPoses();
  return s.solution.status != SolveStatus::not_finite;
}

void forget_contact(HapticState& s) noexcept {
  s.contact.memory.count = 0;
  s.contact.memory.outside = {};
  s.contact.coupling_offset = {};
  s.contact.frozen_step = 0;
  s.placed = {};
  s.behind = {};
  s.patch.step = 0;
  s.unusable_for = 0;
  s.overlap = 0;
}

}  // namespace hapticd
