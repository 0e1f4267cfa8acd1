#include "server/app/simulation_loop.h"

#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cmath>
#include <ctime>
#include <limits>
#include <optional>

#include "haptic/loop.h"
#include "server/observe/contact_forces.h"
#include "server/os/realtime.h"

namespace hapticd {
namespace {

constexpr double refreshed_at[] = {0.6, 0.8};  // periods after a step's begin

// A reference factor may wait; the step on the same core may not. Refused or not, nothing depends on it.
void be_nice() {
  constexpr int lowest = 19;
  setpriority(PRIO_PROCESS, static_cast<id_t>(syscall(SYS_gettid)), lowest);
}

// One writer.
void raise(std::atomic<double>& largest, double value) {
  if (value > largest.load(std::memory_order_relaxed)) largest.store(value, std::memory_order_relaxed);
}

}  // namespace

SimulationLoop::SimulationLoop(World& world, PartTimes& times, double rate,
                               Channel<InstrumentInput>& instrument, Channel<CondensedProblem>& problems,
                               Channel<SceneSnapshot>& snapshots)
    : world_(world),
      times_(times),
      period_ns_(std::llround(1e9 / rate)),
      instrument_(instrument),
      problems_(problems),
      snapshots_(snapshots) {}

SimulationLoop::~SimulationLoop() { stop(); }

void SimulationLoop::start(std::function<void()> on_thread) {
  stopping_ = false;
  references_.start([] {
    name_thread("bases");
    be_nice();
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
}

void SimulationLoop::run() {
  std::int64_t intended = monotonic_ns();
  statistics_.first_ns = intended;
  while (!stopping_) {
    statistics_.last_ns = intended;
    step();
    refresh(intended);
    intended += period_ns_;
    const std::int64_t late = monotonic_ns() - intended;
    if (late > period_ns_) {
      const std::int64_t passed = late / period_ns_;
      statistics_.overruns += static_cast<std::uint64_t>(passed);
      intended += passed * period_ns_;
    }
    sleep_until(intended);
  }
}

InstrumentSample SimulationLoop::latest() {
  instrument_.acquire();
  const InstrumentInput& i = instrument_.front();
  return {i.X, i.present, (i.buttons & pedal_phaco) != 0, (i.buttons & pedal_aspiration) != 0,
          1e-9 * static_cast<double>(i.received_ns)};
}

void SimulationLoop::adopt_references() {
  while (std::optional<ReferenceJob> job = references_.take()) {
    if (job->failed) statistics_.references_failed.fetch_add(1, std::memory_order_relaxed);
    world_.adopt(std::move(*job));
  }
}

void SimulationLoop::count(const StepReport& report) {
  SimulationStatistics& s = statistics_;
  s.steps.fetch_add(1, std::memory_order_relaxed);
  s.removed.fetch_add(static_cast<std::uint64_t>(report.removed), std::memory_order_relaxed);
  s.late_removals.fetch_add(report.removed > 0 && !report.interim, std::memory_order_relaxed);
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
  raise(s.force_peak, report.contact.wrench.head<3>().norm());
  raise(report.removed > 0 ? s.jump_at_removal : s.jump_at_reference, report.handover_jump);
}

void SimulationLoop::step() {
  if (const std::int64_t held = hold_ns_.exchange(0, std::memory_order_relaxed); held > 0)
    sleep_until(monotonic_ns() + held);
  const std::int64_t begin = monotonic_ns();
  times_.start();
  adopt_references();
  const auto publish_interim = [this, begin]() -> CondensedProblem& {
    problems_.back().published_ns = monotonic_ns();
    problems_.publish();
    statistics_.interim.record(monotonic_ns() - begin);
    return problems_.back();
  };
  const StepReport report = world_.step([this] { return latest(); }, problems_.back(), publish_interim);
  CondensedProblem& problem = problems_.back();
  if (poisoned_.exchange(false, std::memory_order_relaxed))
    for (Vec3& x : problem.x_free) x.setConstant(std::numeric_limits<double>::quiet_NaN());
  problem.published_ns = monotonic_ns();
  problems_.publish();
  for (ReferenceJob& job : world_.wanted_references()) references_.give(std::move(job));
  const std::int64_t spent = monotonic_ns() - begin;
  statistics_.step.record(spent);
  count(report);
  publish_snapshot(spent, report);
}

void SimulationLoop::refresh(std::int64_t intended) {
  if (!world_.wants_refresh()) return;
  for (const double at : refreshed_at) {
    const auto due = intended + static_cast<std::int64_t>(at * static_cast<double>(period_ns_));
    if (stopping_ || monotonic_ns() > due) continue;
    sleep_until(due);
    const std::int64_t begin = monotonic_ns();
    if (!world_.refresh(latest(), problems_.back())) continue;
    problems_.back().published_ns = monotonic_ns();
    problems_.publish();
    statistics_.refresh.record(monotonic_ns() - begin);
  }
}

void SimulationLoop::publish_snapshot(std::int64_t step_ns, const StepReport& report) {
  SceneSnapshot& snapshot = snapshots_.back();
  const Bodies& bodies = world_.bodies();
  snapshot.step = world_.steps();
  snapshot.bodies.resize(bodies.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (!bodies[b].deformable) continue;
    BodySnapshot& out = snapshot.bodies[b];
    out.nodes.resize(3 * bodies[b].state.x.size());
    for (std::size_t n = 0; n < bodies[b].state.x.size(); ++n)
      Eigen::Map<Eigen::Vector3f>(&out.nodes[3 * n]) = bodies[b].state.x[n].cast<float>();
    pack_bits(bodies[b].state.alive, out.alive);
  }
  snapshot.instrument = instrument_.front().X;
  snapshot.contacts.clear();
  for (const ContactForce& c : contact_forces(world_.contact_scratch(), report.contact.instrument)) {
    for (const Vec3& v : {c.place, c.force})
      for (int i = 0; i < 3; ++i) snapshot.contacts.push_back(static_cast<float>(v[i]));
    snapshot.contacts.push_back(static_cast<float>(c.gap));
  }
  snapshot.elements_removed = static_cast<std::uint32_t>(statistics_.removed.load(std::memory_order_relaxed));
  snapshot.fragments_aspirated =
      static_cast<std::uint32_t>(statistics_.aspirated.load(std::memory_order_relaxed));
  snapshot.step_ms = 1e-6 * static_cast<double>(step_ns);
  snapshot.rate_hz = statistics_.rate_hz();
  times_.enter(static_cast<int>(StepPart::publish));  // which ends the part so far
  for (std::size_t p = 0; p < step_parts; ++p) part_ns_[p] += times_.ns(static_cast<StepPart>(p));
  snapshot.health.step = world_.steps();
  snapshot.health.part_ns = part_ns_;
  snapshot.health.bodies = report.compliance;
  snapshots_.publish();
}

}  // namespace hapticd
