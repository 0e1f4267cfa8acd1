#include "haptic/loop.h"

#include <sys/resource.h>
#include <time.h>

#include <cerrno>
#include <limits>
#include <stdexcept>
#include <system_error>

#include "haptic/allocation_count.h"

namespace hapticd {
namespace {

using allocation_count::Mark;
using allocation_count::Region;

constexpr auto relaxed = std::memory_order_relaxed;

// A longer stall than this many slots is recorded only this often: the tick stays bounded.
constexpr std::int64_t max_recorded_misses = 10'000;

// A state is waited for only from a client that has sent one for each of this many ticks in a row: one at
// another rate would have every tick without a state late.
constexpr int steady_ticks = 8;
constexpr std::int64_t look_again_ns = 50'000;

// The loop's thread is the only writer, so load and store suffice.
template <typename T>
void add(std::atomic<T>& a, T n) noexcept {
  a.store(a.load(relaxed) + n, relaxed);
}
void raise(std::atomic<double>& a, double v) noexcept {
  if (v > a.load(relaxed)) a.store(v, relaxed);
}

std::int64_t page_faults_of_thread() noexcept {
  rusage usage{};
  getrusage(RUSAGE_THREAD, &usage);
  return usage.ru_minflt + usage.ru_majflt;
}

// The time left until a solve is to end, and what was answered to whom asked.
struct SolveClock {
  std::int64_t until_ns;
  ClockAnswers* answers;  // null: not kept

  static std::int64_t left_ns(const void* clock) noexcept {
    const auto& self = *static_cast<const SolveClock*>(clock);
    std::int64_t left = self.until_ns - monotonic_ns();
    if (!self.answers) return left;
    ClockAnswers& a = *self.answers;
    left = std::max<std::int64_t>(left, std::numeric_limits<std::int32_t>::min());
    if (a.count < ClockAnswers::capacity) a.left_ns[a.count] = static_cast<std::int32_t>(left);
    ++a.count;
    return left;
  }
};

}  // namespace

std::int64_t monotonic_ns() noexcept {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

void sleep_until(std::int64_t ns) noexcept {
  const timespec t{ns / 1'000'000'000, ns % 1'000'000'000};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr) == EINTR) {
  }
}

HapticLoop::HapticLoop(const Instrument& instrument, const DeviceSettings& device,
                       const HapticOptions& options, DevicePort& port, Channel<CondensedProblem>& problems,
                       Channel<InstrumentInput>& instrument_inputs, SpscQueue<ForceRecord>& history,
                       const LoopTiming& timing)
    : tick_(instrument, device, options, problems),
      port_(port),
      instrument_inputs_(instrument_inputs),
      history_(history),
      timing_(timing) {}

HapticLoop::~HapticLoop() { stop(); }

void HapticLoop::start(std::function<void()> on_thread) {
  try {
    thread_ = std::thread([this, on_thread = std::move(on_thread)] {
      if (on_thread) on_thread();
      run();
    });
  } catch (const std::system_error& e) {
    throw std::runtime_error(std::string("cannot start the haptic thread: ") + e.what());
  }
}

void HapticLoop::stop() noexcept {
  stopping_.store(true, relaxed);
  if (thread_.joinable()) thread_.join();
}

void HapticLoop::run() noexcept {
  if (timing_.mode == LoopMode::tick)
    run_on_grid();
  else
    run_on_arrivals();
  ForceSample last;
  last.sequence = tick_.state().tick + 1;
  port_.write(last);
}

void HapticLoop::run_on_grid() noexcept {
  std::int64_t intended = monotonic_ns() + options().watchdog.period_ns;
  statistics_.first_ns.store(intended, relaxed);
  while (!stopping_.load(relaxed)) {
    wait_for(intended);
    tick(intended);
    intended = next_slot(intended);
  }
}

// Sleeps for most of it: reading the clock keeps Cyclone's threads off this core.
void HapticLoop::wait_for(std::int64_t intended) noexcept {
  const std::int64_t early = intended - timing_.early_ns;
  sleep_until(early);
  std::int64_t now = monotonic_ns();
  statistics_.timer.record(now - early);
  while (now < intended) now = monotonic_ns();
}

void HapticLoop::run_on_arrivals() noexcept {
  const std::int64_t period = options().watchdog.period_ns;
  std::int64_t last = monotonic_ns();
  bool arrival = false;
  statistics_.first_ns.store(last, relaxed);
  while (!stopping_.load(relaxed)) {
    const std::int64_t deadline = last + (arrival ? 3 * period / 2 : period);
    const std::int64_t arrived = port_.await(deadline);
    const std::int64_t earliest = arrival ? last + timing_.min_answer_ns : last;
    arrival = arrived != 0;
    const std::int64_t intended = arrival ? std::max(arrived, earliest) : deadline;
    if (arrived != 0 && arrived < earliest) sleep_until(earliest);
    tick(intended);
    last = next_slot(intended) - period;
  }
}

void HapticLoop::tick(std::int64_t intended) noexcept {
  const std::int64_t woken = monotonic_ns();
  const Mark ours(Region::haptic);
  const std::int64_t interval = last_woken_ns_ > 0 ? woken - last_woken_ns_ : 0;
  last_woken_ns_ = woken;

  HapticInput input;
  if (timing_.mode == LoopMode::event)
    input.period_ns = std::clamp(interval, std::int64_t{1}, options().watchdog.period_ns);
  const bool retuned = tunings_ && tunings_->acquire();
  if (retuned) tick_.retune(tunings_->front());
  if (record_) record_->facts.retuned = retuned;
  {
    const Mark theirs(Region::transport);
    take(intended, input);
  }

  ForceSample force;
  const std::int64_t solved = solve_by_clock(input, force);
  force.wake_ns = woken - intended;

  {
    const Mark theirs(Region::transport);
    port_.write(force);
  }
  const std::int64_t written = monotonic_ns();

  const HapticState& state = tick_.state();
  const InstrumentInput instrument = tick_.instrument(input.now_ns);
  instrument_inputs_.back() = instrument;
  instrument_inputs_.publish();
  history_.push({intended, force, state.watchdog.sample.pose, instrument});
  if (record_) record(input, force);

  // What was solved: the published problem, or the patch made from it.
  if (captures_ && state.solved) capture(state.patch.step > 0 ? state.patch.problem : *tick_.problem(), force);
  statistics_.write.record(written - solved);
  if (interval > 0) statistics_.interval.record(interval);
  count(force);
  count_page_faults(force);
}

// When it was solved.
std::int64_t HapticLoop::solve_by_clock(HapticInput& input, ForceSample& force) noexcept {
  if (captures_) before_ = tick_.state().contact;
  if (record_) record_->clock.count = 0;
  const std::int64_t begun = monotonic_ns();
  const SolveClock clock{begun + options().solve_budget_ns, record_ ? &record_->clock : nullptr};
  input.deadline.clock = &clock;
  input.deadline.left_ns = SolveClock::left_ns;
  force = tick_.run(input);
  input.deadline = {};
  const std::int64_t solved = monotonic_ns();
  force.solve_ns = solved - begun;
  return solved;
}

void HapticLoop::record_into(SpscQueue<TickRecord>& records) {
  records_ = &records;
  record_ = std::make_unique<TickRecord>();
}

void HapticLoop::record(const HapticInput& input, const ForceSample& force) noexcept {
  TickFacts& r = record_->facts;
  r.now_ns = input.now_ns;
  r.period_ns = input.period_ns;
  r.presence = input.presence;
  r.taken = input.taken;
  r.sample = input.sample;
  if (r.retuned) r.tuning = tunings_->front();
  r.tick = force.sequence;
  r.problem = force.step;
  r.force = force.force;
  r.torque = force.torque;
  r.status = force.status;
  records_->push(*record_);
}

// Until when a tick that first looks at `now` waits for a state. Behind a stall that counts from the grid
// point that it is now. Such a stall has mostly held up the client too, which sends what it is late with in a
// moment: that state would be overtaken by its next one, which is due half a period behind the grid point.
std::int64_t HapticLoop::waits_until(std::int64_t intended, std::int64_t now) const noexcept {
  if (timing_.mode == LoopMode::event || timing_.late_state_ns == 0 || answered_in_a_row_ < steady_ticks)
    return 0;
  const std::int64_t period = options().watchdog.period_ns;
  const std::int64_t late = (now - intended) % period, grid_point = now - late;
  if (late > period / 2) return 0;
  return grid_point + std::max(timing_.late_state_ns, late + timing_.behind_stall_ns);
}

// The newest state, and one that is a little late of a client that has been punctual so far.
void HapticLoop::take(std::int64_t intended, HapticInput& input) noexcept {
  const std::int64_t until = waits_until(intended, monotonic_ns());
  for (bool first = true;; first = false) {
    input.now_ns = monotonic_ns();
    input.taken = port_.take(input.now_ns, input.sample);
    const Presence seen = port_.presence();
    input.presence = {seen.connected, input.presence.new_client || seen.new_client,
                      input.presence.conflict || seen.conflict, seen.rival, seen.settled};
    if (input.taken && !first) add(statistics_.late_states, std::uint64_t{1});
    if (input.taken || !seen.connected || input.now_ns + look_again_ns > until) break;
    sleep_until(input.now_ns + look_again_ns);
  }
  answered_in_a_row_ = input.taken ? std::min(answered_in_a_row_ + 1, steady_ticks) : 0;
}

// A system call a tick would be felt; seven times a second it is not.
void HapticLoop::count_page_faults(const ForceSample& force) noexcept {
  constexpr std::uint64_t every = 128;
  if (faults_before_ < 0) {
    if (force.status & status_disarmed) return;
    faults_before_ = page_faults_of_thread();
  } else if (tick_.state().tick % every == 0) {
    statistics_.page_faults.store(static_cast<std::uint64_t>(page_faults_of_thread() - faults_before_),
                                  relaxed);
  }
}

void HapticLoop::capture_into(Channel<ContactCapture>& captures, std::uint64_t every) {
  captures_ = &captures;
  capture_every_ = every;
}

void HapticLoop::capture(const CondensedProblem& problem, const ForceSample& force) noexcept {
  constexpr std::uint64_t ticks_between = 20;
  ++solves_;
  // A tick that had a removal in it may have been solved in two parts.
  if (problem.topology_changed && tick_.state().patch.step > 0 &&
      tick_.state().patch.period < 0.9e-9 * static_cast<double>(options().watchdog.period_ns))
    return;
  const bool capped = (force.status & status_solver_cap) != 0;
  if (!capped && (capture_every_ == 0 || solves_ % capture_every_ != 0)) return;
  if (last_capture_ > 0 && force.sequence - last_capture_ < ticks_between) return;
  last_capture_ = force.sequence;
  ContactCapture& c = captures_->back();
  copy_in_use(problem, c.problem);
  c.state = before_;
  c.X = to_scene(tick_.device(), tick_.state().watchdog.sample.pose);
  c.period = 1e-9 * static_cast<double>(options().watchdog.period_ns);
  c.margin = options().contact.margin;
  c.linearisations = options().contact.linearisations;
  c.tolerance = options().contact.coulomb.tolerance;
  c.status = capped ? SolveStatus::iteration_cap : SolveStatus::solved;
  c.residual = force.residual;
  c.wrench = tick_.state().solution.wrench;
  captures_->publish();
}

void HapticLoop::count(const ForceSample& force) noexcept {
  statistics_.wake.record(force.wake_ns);
  if (tick_.state().solved) {
    statistics_.solve.record(force.solve_ns);
    raise(statistics_.penetration_max, force.penetration);
  }
  if (force.problem_age_ns >= 0) statistics_.problem_age.record(force.problem_age_ns);
  add(statistics_.run, std::uint64_t{1});
  if (force.answers) {
    statistics_.state_age.record(force.state_age_ns);
    add(statistics_.answered, std::uint64_t{1});
  }
  if (force.status & status_solver_cap) add(statistics_.solver_caps, std::uint64_t{1});
  statistics_.refused.store(tick_.state().watchdog.refused, relaxed);
  statistics_.conflicts.store(tick_.state().watchdog.conflicts, relaxed);
  statistics_.status.store(force.status, relaxed);
  raise(statistics_.force_peak, force.force.norm());
}

std::int64_t HapticLoop::next_slot(std::int64_t intended) noexcept {
  const std::int64_t period = options().watchdog.period_ns;
  const std::int64_t ended = monotonic_ns();
  std::int64_t next = intended + period;
  if (ended > next) {
    const std::int64_t missed = (ended - next) / period + 1;
    for (std::int64_t i = 0; i < std::min(missed, max_recorded_misses); ++i) {
      statistics_.wake.record(ended - next - i * period);
      if (timing_.mode == LoopMode::tick) statistics_.timer.record(ended - next - i * period);
    }
    next += missed * period;
    add(statistics_.deadline_misses, std::uint64_t{1});
    add(statistics_.missed, static_cast<std::uint64_t>(missed));
  }
  statistics_.next_ns.store(next, relaxed);
  return next;
}

}  // namespace hapticd
