#include "server/app/simulation_loop.h"

#include <cmath>
#include <limits>

#include "haptic/clock.h"
#include "haptic/contact/problem_check.h"
#include "server/observe/contact_forces.h"
#include "server/os/realtime.h"

namespace hapticd {
namespace {

// One writer.
void raise(std::atomic<double>& largest, double value) {
  if (value > largest.load(std::memory_order_relaxed)) largest.store(value, std::memory_order_relaxed);
}

}  // namespace

SimulationLoop::SimulationLoop(World& world, PartTimes& times, double rate,
                               Channel<InstrumentInputs>& instruments, Channel<CondensedProblem>& problems,
                               std::vector<Channel<SceneSnapshot>*> snapshots)
    : world_(world),
      times_(times),
      schedule_(world, std::llround(1e9 / rate)),
      instruments_(instruments),
      problems_(problems),
      snapshots_(std::move(snapshots)),
      operation_(world) {}

SimulationLoop::~SimulationLoop() { stop(); }

void SimulationLoop::start(std::function<void()> on_thread) {
  stopping_ = false;
  references_.start([] { name_thread("references"); });
  far_tissue_.start([] {
    name_thread("far tissue");
    use_nice(far_tissue_nice);
  });
  thread_ = std::thread([this, on_thread = std::move(on_thread)] {
    name_thread("simulation");
    if (on_thread) on_thread();
    try {
      run();
    } catch (const std::exception& e) {
      failure_ = e.what();
      failed_.store(true, std::memory_order_release);
    }
  });
}

void SimulationLoop::stop() noexcept {
  stopping_ = true;
  if (thread_.joinable()) thread_.join();
  references_.stop();
  far_tissue_.stop();
}

void SimulationLoop::run() {
  const std::int64_t first = monotonic_ns();
  statistics_.first_ns = first;
  schedule_.start(first);
  followed_ns_ = first - schedule_.period_ns();
  while (!stopping_) {
    const PlannedAction planned = schedule_.next(monotonic_ns());
    if (planned.due_ns > planned.asked_ns) sleep_until(planned.due_ns);
    perform(planned);
  }
}

void SimulationLoop::perform(const PlannedAction& planned) {
  now_ = planned;
  if (planned.action == StepAction::begin) begin_counting(planned);
  if (planned.action == StepAction::refresh) begun_ns_ = monotonic_ns();
  schedule_.perform(planned, *this);
  if (planned.action == StepAction::publish) end_counting();
}

void SimulationLoop::begin_counting(const PlannedAction& planned) {
  statistics_.overruns += static_cast<std::uint64_t>(planned.skipped);
  statistics_.last_ns = planned.step_ns;
  if (const std::int64_t held = hold_ns_.exchange(0, std::memory_order_relaxed); held > 0)
    sleep_until(monotonic_ns() + held);
  begun_ns_ = monotonic_ns();
  times_.start();
}

void SimulationLoop::end_counting() {
  const std::int64_t spent = published_ns_ - begun_ns_;
  statistics_.step.record(spent);
  count(schedule_.report());
  const std::int64_t elapsed = now_.step_ns - std::exchange(followed_ns_, now_.step_ns);
  operation_.follow(world_, schedule_.report(), samples_of(instruments_.front()),
                    1e-9 * static_cast<double>(elapsed));
  publish_snapshots(spent, schedule_.report());
}

InstrumentSamples SimulationLoop::latch() {
  instruments_.acquire();
  const InstrumentSamples samples = samples_of(instruments_.front());
  record({.action = now_.action, .asked_ns = now_.asked_ns, .step_ns = now_.step_ns, .samples = samples});
  return samples;
}

std::optional<ReferenceJob> SimulationLoop::finished_reference() {
  std::optional<ReferenceJob> job = references_.take();
  if (!job) job = far_tissue_.take();
  if (!job) return job;
  if (job->failed) statistics_.references_failed.fetch_add(1, std::memory_order_relaxed);
  record({.adopted = true, .failed = job->failed, .kind = job->kind, .body = job->body});
  return job;
}

void SimulationLoop::publish(StepAction as) {
  CondensedProblem& problem = problems_.back();
  if (as == StepAction::publish && poisoned_.exchange(false, std::memory_order_relaxed))
    for (Vec3& x : problem.x_free) x.setConstant(std::numeric_limits<double>::quiet_NaN());
  problem.known_sound = is_sound(problem);
  const std::int64_t now = published_ns_ = monotonic_ns();
  problem.published_ns = now;
  const std::uint64_t number = problem.step;
  if (copies_) {
    copy_in_use(problem, copies_->back());
    copies_->publish();
  }
  problems_.publish();
  record({.action = as,
          .asked_ns = now_.asked_ns,
          .step_ns = now_.step_ns,
          .problem = number,
          .published_ns = now});
  if (as == StepAction::publish_interim) statistics_.interim.record(monotonic_ns() - begun_ns_);
  if (as == StepAction::publish_refresh) statistics_.refresh.record(monotonic_ns() - begun_ns_);
}

void SimulationLoop::count(const StepReport& report) {
  SimulationStatistics& s = statistics_;
  s.steps.fetch_add(1, std::memory_order_relaxed);
  s.removed.fetch_add(static_cast<std::uint64_t>(report.removed), std::memory_order_relaxed);
  const bool at_begin = report.removed > report.removed_ahead;
  s.late_removals.fetch_add(at_begin && !report.interim, std::memory_order_relaxed);
  s.cut_steps.fetch_add(report.split, std::memory_order_relaxed);
  if (report.out_of_room) s.out_of_room.store(true, std::memory_order_relaxed);
  s.condensed_steps.fetch_add(report.condensed_nodes > 0, std::memory_order_relaxed);
  s.aspirated.fetch_add(static_cast<std::uint64_t>(report.fragments_aspirated), std::memory_order_relaxed);
  s.references.fetch_add(static_cast<std::uint64_t>(report.references_adopted), std::memory_order_relaxed);
  s.synchronous_references.fetch_add(static_cast<std::uint64_t>(report.synchronous_references),
                                     std::memory_order_relaxed);
  bool degraded = false;
  for (const BodyReport& b : report.compliance) {
    degraded = degraded || b.compliance.health == ComplianceHealth::degraded;
    raise(s.compliance_error, b.compliance.error);
    raise(s.rotation, b.compliance.rotation_since_reference);
  }
  if (degraded) s.rough_steps.fetch_add(1, std::memory_order_relaxed);
  for (const Vec6& wrench : report.contact.wrench.value) raise(s.force_peak, wrench.head<3>().norm());
  raise(at_begin ? s.jump_at_removal : s.jump_at_reference, report.handover_jump);
}

void SimulationLoop::show_bodies(const StepReport& report, SceneSnapshot& snapshot) {
  const Bodies& bodies = world_.bodies();
  snapshot.bodies.resize(bodies.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) take_snapshot(bodies[b], snapshot.bodies[b]);
  snapshot.instruments.resize(world_.instruments().size());
  for (std::size_t i = 0; i < snapshot.instruments.size(); ++i)
    snapshot.instruments[i] = instruments_.front()[static_cast<int>(i)].X;
  snapshot.contacts.clear();
  snapshot.pressing.clear();
  for (const ContactForce& c : contact_forces(world_.contact_scratch(), report.contact.instrument)) {
    for (const Vec3& v : {c.place, c.force})
      for (int i = 0; i < 3; ++i) snapshot.contacts.push_back(static_cast<float>(v[i]));
    snapshot.contacts.push_back(static_cast<float>(c.gap));
    snapshot.pressing.push_back(static_cast<std::uint8_t>(c.instrument));
    snapshot.pressing.push_back(c.other < 0 ? pressed_tissue : static_cast<std::uint8_t>(c.other));
  }
}

void SimulationLoop::publish_snapshots(std::int64_t step_ns, const StepReport& report) {
  if (!snapshots_.empty()) show_bodies(report, snapshots_.front()->back());
  times_.enter(static_cast<int>(StepPart::publish));  // which ends the part so far
  for (std::size_t p = 0; p < step_parts; ++p) part_ns_[p] += times_.ns(static_cast<StepPart>(p));
  for (Channel<SceneSnapshot>* channel : snapshots_) {
    SceneSnapshot& snapshot = channel->back();
    snapshot.step = world_.steps();
    snapshot.elements_removed =
        static_cast<std::uint32_t>(statistics_.removed.load(std::memory_order_relaxed));
    snapshot.fragments_aspirated =
        static_cast<std::uint32_t>(statistics_.aspirated.load(std::memory_order_relaxed));
    snapshot.step_ms = 1e-6 * static_cast<double>(step_ns);
    snapshot.rate_hz = statistics_.rate_hz();
    snapshot.health.step = world_.steps();
    snapshot.health.part_ns = part_ns_;
    snapshot.health.bodies = report.compliance;
    if (channel == snapshots_.front()) snapshot.operation_events = operation_.newest(snapshot.operation);
    channel->publish();
  }
}

}  // namespace hapticd
