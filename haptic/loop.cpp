#include "haptic/loop.h"

#include <sys/resource.h>

#include <limits>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "haptic/allocation_count.h"
#include "haptic/clock.h"

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

std::vector<DeviceSettings> settings_of(const std::vector<LoopDevice>& devices) {
  std::vector<DeviceSettings> settings;
  for (const LoopDevice& d : devices) settings.push_back(d.settings);
  return settings;
}

}  // namespace

HapticLoop::HapticLoop(Instruments instruments, const std::vector<LoopDevice>& devices,
                       const HapticOptions& options, Channel<CondensedProblem>& problems,
                       Channel<InstrumentInputs>& instrument_inputs, const LoopTiming& timing)
    : devices_(devices),
      tick_(std::make_unique<HapticTick>(instruments, settings_of(devices), options, problems)),
      instrument_inputs_(instrument_inputs),
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
  last.sequence = tick_->state().tick + 1;
  for (const LoopDevice& d : devices_) d.port.write(last);
}

void HapticLoop::run_on_grid() noexcept {
  std::int64_t intended = monotonic_ns() + options().watchdog.period_ns;
  for (LoopStatistics& s : statistics_.value) s.first_ns.store(intended, relaxed);
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
  for (int i = 0; i < devices(); ++i) statistics_[i].timer.record(now - early);
  while (now < intended) now = monotonic_ns();
}

void HapticLoop::run_on_arrivals() noexcept {
  const std::int64_t period = options().watchdog.period_ns;
  EachInstrument<std::int64_t> earliest;
  std::int64_t last = monotonic_ns();
  bool arrival = false;
  for (LoopStatistics& s : statistics_.value) s.first_ns.store(last, relaxed);
  while (!stopping_.load(relaxed)) {
    const std::int64_t deadline = last + (arrival ? 3 * period / 2 : period);
    const std::int64_t due = device(0).port.await(deadline, earliest);
    arrival = due != 0;
    const std::int64_t intended = arrival ? due : deadline;
    tick(intended);
    last = next_slot(intended) - period;
    for (int i = 0; i < devices(); ++i) {
      const bool answered = answered_in_a_row_[i] > 0;
      if (answered || devices() > 1)
        earliest[i] = std::max(earliest[i], last + (answered ? timing_.min_answer_ns : timing_.min_tick_ns));
    }
  }
}

void HapticLoop::tick(std::int64_t intended) noexcept {
  const std::int64_t woken = monotonic_ns();
  const Mark ours(Region::haptic);
  const std::int64_t interval = last_woken_ns_ > 0 ? woken - last_woken_ns_ : 0;
  last_woken_ns_ = woken;

  HapticInput input;
  take_next();
  if (timing_.mode == LoopMode::event)
    input.period_ns = std::clamp(interval, std::int64_t{1}, options().watchdog.period_ns);
  retune();
  {
    const Mark theirs(Region::transport);
    take(intended, input);
  }

  const std::int64_t solved = solve_by_clock(intended, input);
  for (int i = 0; i < devices(); ++i) forces_[i].wake_ns = woken - intended;
  {
    const Mark theirs(Region::transport);
    // Who waits for an answer has it first.
    for (const bool answers : {true, false})
      for (int i = 0; i < devices(); ++i)
        if (forces_[i].answers == answers) device(i).port.write(forces_[i]);
  }
  const std::int64_t written = monotonic_ns();

  bool zero = withheld_.load(relaxed);
  for (int i = 0; i < devices(); ++i)
    zero = zero && forces_[i].force.isZero(0) && forces_[i].torque.isZero(0);
  at_zero_.store(zero, std::memory_order_release);

  const HapticState& state = tick_->state();
  const InstrumentInputs& instruments = instrument_inputs_.back() = tick_->instruments(input.now_ns);
  for (int i = 0; i < devices(); ++i)
    device(i).history.push({intended, forces_[i], state.device[i].watchdog.sample.pose, instruments[i]});
  if (copies_) {
    copies_->back() = instruments;
    copies_->publish();
  }
  instrument_inputs_.publish();
  if (record_) record(input);

  // What was solved: the published problem, or the patch made from it.
  if (captures_.asked_for() && state.solved)
    captures_.after(state.patch.step > 0 ? state.patch.problem : *tick_->problem(), state, options());
  bool armed = true;
  for (int i = 0; i < devices(); ++i) {
    statistics_[i].write.record(written - solved);
    if (interval > 0) statistics_[i].interval.record(interval);
    count(i, forces_[i]);
    armed = armed && (forces_[i].status & status_disarmed) == 0;
  }
  count_page_faults(armed);
}

std::unique_ptr<HapticTick> HapticLoop::exchange(std::unique_ptr<HapticTick> next) {
  if (!thread_.joinable()) {
    next->take_over(*tick_);
    return std::exchange(tick_, std::move(next));
  }
  next_.store(next.release(), std::memory_order_release);
  HapticTick* former = nullptr;
  while (!(former = former_.exchange(nullptr, std::memory_order_acquire)))
    sleep_until(monotonic_ns() + look_again_ns);
  return std::unique_ptr<HapticTick>(former);
}

void HapticLoop::take_next() noexcept {
  HapticTick* next = next_.exchange(nullptr, std::memory_order_acquire);
  if (!next) return;
  next->take_over(*tick_);
  former_.store(tick_.release(), std::memory_order_release);
  tick_.reset(next);
}

void HapticLoop::retune() noexcept {
  for (int i = 0; i < devices(); ++i) {
    Channel<DeviceTuning>* tunings = device(i).tunings;
    const bool retuned = tunings && tunings->acquire();
    if (retuned) tick_->retune(i, tunings->front());
    if (record_) record_->facts.device[i].retuned = retuned;
  }
}

// When it was solved.
std::int64_t HapticLoop::solve_by_clock(std::int64_t intended, HapticInput& input) noexcept {
  captures_.before(tick_->state().contact);
  if (record_) record_->clock.count = 0;
  const std::int64_t begun = monotonic_ns(), budget = options().solve_budget_ns;
  const SolveClock clock{std::max(intended + budget, begun + budget * 3 / 4),
                         record_ ? &record_->clock : nullptr};
  input.deadline.clock = &clock;
  input.deadline.left_ns = SolveClock::left_ns;
  forces_ = tick_->run(input, withheld_.load(std::memory_order_acquire));
  input.deadline = {};
  const std::int64_t solved = monotonic_ns();
  for (ForceSample& force : forces_.value) force.solve_ns = solved - begun;
  return solved;
}

void HapticLoop::record_into(SpscQueue<TickRecord>& records) {
  records_ = &records;
  record_ = std::make_unique<TickRecord>();
}

void HapticLoop::record(const HapticInput& input) noexcept {
  TickFacts& r = record_->facts;
  r.now_ns = input.now_ns;
  r.period_ns = input.period_ns;
  r.tick = forces_[0].sequence;
  r.problem = forces_[0].step;
  r.devices = devices();
  for (int i = 0; i < devices(); ++i) {
    DeviceFacts& d = r.device[i];
    d.input = input.device[i];
    if (d.retuned) d.tuning = device(i).tunings->front();
    d.force = forces_[i].force;
    d.torque = forces_[i].torque;
    d.status = forces_[i].status;
  }
  records_->push(*record_);
}

// Until when a tick that first looks at `now` waits for a state. Behind a stall that counts from the grid
// point that it is now. Such a stall has mostly held up the client too, which sends what it is late with in a
// moment: that state would be overtaken by its next one, which is due half a period behind the grid point.
std::int64_t HapticLoop::waits_until(std::int64_t intended, std::int64_t now) const noexcept {
  if (timing_.mode == LoopMode::event || timing_.late_state_ns == 0) return 0;
  bool steady = false;
  for (const int ticks : answered_in_a_row_.value) steady = steady || ticks >= steady_ticks;
  if (!steady) return 0;
  const std::int64_t period = options().watchdog.period_ns;
  const std::int64_t late = (now - intended) % period, grid_point = now - late;
  if (late > period / 2) return 0;
  return grid_point + std::max(timing_.late_state_ns, late + timing_.behind_stall_ns);
}

// The newest states, and those that are a little late of clients that have been punctual so far.
void HapticLoop::take(std::int64_t intended, HapticInput& input) noexcept {
  const std::int64_t until = waits_until(intended, monotonic_ns());
  for (bool first = true;; first = false) {
    input.now_ns = monotonic_ns();
    if (take_all(input, first) || input.now_ns + look_again_ns > until) break;
    sleep_until(input.now_ns + look_again_ns);
  }
  for (int i = 0; i < devices(); ++i)
    answered_in_a_row_[i] = input.device[i].taken ? std::min(answered_in_a_row_[i] + 1, steady_ticks) : 0;
}

// Whether there is nobody left to be waited for.
bool HapticLoop::take_all(HapticInput& input, bool first) noexcept {
  bool all = true;
  for (int i = 0; i < devices(); ++i) {
    DeviceInput& d = input.device[i];
    if (d.taken) continue;
    DevicePort& port = device(i).port;
    d.taken = port.take(input.now_ns, d.sample);
    const Presence seen = port.presence();
    d.presence = {seen.connected, d.presence.new_client || seen.new_client,
                  d.presence.conflict || seen.conflict, seen.rival, seen.settled};
    if (d.taken && !first) add(statistics_[i].late_states, std::uint64_t{1});
    const bool punctual = devices() == 1 || answered_in_a_row_[i] >= steady_ticks;
    all = all && (d.taken || !seen.connected || !punctual);
  }
  return all;
}

// A system call a tick would be felt; seven times a second it is not.
void HapticLoop::count_page_faults(bool armed) noexcept {
  constexpr std::uint64_t every = 128;
  if (faults_before_ < 0) {
    if (!armed) return;
    faults_before_ = page_faults_of_thread();
  } else if (tick_->state().tick % every == 0) {
    const auto faults = static_cast<std::uint64_t>(page_faults_of_thread() - faults_before_);
    for (LoopStatistics& s : statistics_.value) s.page_faults.store(faults, relaxed);
  }
}

void HapticLoop::count(int i, const ForceSample& force) noexcept {
  LoopStatistics& s = statistics_[i];
  const HapticState& state = tick_->state();
  s.wake.record(force.wake_ns);
  if (state.in_contact(i)) {
    s.solve.record(force.solve_ns);
    raise(s.penetration_max, force.penetration);
  }
  if (force.problem_age_ns >= 0) s.problem_age.record(force.problem_age_ns);
  add(s.run, std::uint64_t{1});
  if (force.answers) {
    s.state_age.record(force.state_age_ns);
    add(s.answered, std::uint64_t{1});
  }
  if (force.status & status_solver_cap) add(s.solver_caps, std::uint64_t{1});
  if (force.status & status_contacts_dropped) add(s.contacts_dropped, std::uint64_t{1});
  const WatchdogState& w = state.device[i].watchdog;
  s.silent.store((force.status & status_disarmed) && !(force.status & status_latched) && w.has_sample &&
                     w.sample.enable && !w.may_arm,
                 relaxed);
  s.samples.store(force.samples, relaxed);
  s.samples_dropped.store(force.samples_dropped, relaxed);
  s.refused.store(state.device[i].watchdog.refused, relaxed);
  s.conflicts.store(state.device[i].watchdog.conflicts, relaxed);
  s.status.store(force.status, relaxed);
  raise(s.force_peak, force.force.norm());
}

std::int64_t HapticLoop::next_slot(std::int64_t intended) noexcept {
  const std::int64_t period = options().watchdog.period_ns;
  const std::int64_t ended = monotonic_ns();
  std::int64_t next = intended + period, missed = 0;
  if (ended > next) {
    missed = (ended - next) / period + 1;
    next += missed * period;
  }
  for (int i = 0; i < devices(); ++i) {
    LoopStatistics& s = statistics_[i];
    for (std::int64_t k = 0; k < std::min(missed, max_recorded_misses); ++k) {
      const std::int64_t late = ended - next + (missed - k) * period;
      s.wake.record(late);
      if (timing_.mode == LoopMode::tick) s.timer.record(late);
    }
    if (missed > 0) {
      add(s.deadline_misses, std::uint64_t{1});
      add(s.missed, static_cast<std::uint64_t>(missed));
    }
    s.next_ns.store(next, relaxed);
  }
  return next;
}

}  // namespace hapticd
