#include "server/schedule/virtual_daemon.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr std::int64_t least_period = ms / 10;

std::int64_t period_of(double rate) {
  const std::int64_t period = std::llround(1e9 / rate);
  if (period < least_period) throw std::invalid_argument("a simulation's period is 0.1 ms at least");
  return period;
}

bool publishes(StepAction a) {
  return a == StepAction::publish_interim || a == StepAction::publish || a == StepAction::publish_refresh;
}

std::vector<DeviceSettings> as_answered(std::vector<DeviceSettings> devices,
                                        const std::function<bool(int)>& answered) {
  for (std::size_t i = 0; i < devices.size(); ++i)
    if (!answered(static_cast<int>(i))) devices[i] = in_scene(devices[i]);
  return devices;
}

// Beside the simulation: all, where it is one loop.
std::vector<DeviceSettings> answered_here(const std::vector<DeviceSettings>& devices,
                                          const EachInstrument<bool>& at_simulation) {
  bool any = false;
  for (const bool there : at_simulation.value) any = any || there;
  return as_answered(devices, [&](int i) { return !any || at_simulation[i]; });
}

}  // namespace

VirtualTiming usual_timing(const World& world) {
  VirtualTiming timing;
  if (!world.looks_ahead()) timing.latch = 6 * ms;
  return timing;
}

VirtualDaemon::VirtualDaemon(std::unique_ptr<World> world, double rate, std::vector<DeviceSettings> devices,
                             const HapticOptions& options, VirtualDaemonSettings settings)
    : settings_(std::move(settings)),
      world_(std::move(world)),
      schedule_(*world_, period_of(rate), settings_.schedule),
      timing_(settings_.timing ? *settings_.timing : usual_timing(*world_)),
      haptic_(world_->instruments(), answered_here(devices, settings_.at_simulation), options, problems_),
      halves_(settings_.link ? std::make_unique<Halves>(*settings_.link) : nullptr),
      free_ns_(settings_.first_ns) {
  const auto& there = settings_.at_simulation.value;
  if (halves_ && std::find(there.begin(), there.end(), true) != there.end())
    edge_ = std::make_unique<Edge>(world_->instruments(), devices, options, settings_.at_simulation);
  schedule_.warm_up(problem());
  schedule_.start(settings_.first_ns);
}

std::int64_t VirtualDaemon::time_of(const PlannedAction& planned) const {
  const std::int64_t period = schedule_.period_ns(), publish = std::min(timing_.publish, period);
  const auto at = [&](std::int64_t after) { return std::max(free_ns_, begun_ns_ + after); };
  switch (planned.action) {
    case StepAction::publish_interim:
      return at(std::min(timing_.interim, publish));
    case StepAction::finish: {
      const std::int64_t latch =
          schedule_.begun().removed > 0 ? std::max(timing_.latch, timing_.removal_latch) : timing_.latch;
      return at(std::clamp<std::int64_t>(latch, 0, std::max<std::int64_t>(0, period - ms)) +
                timing_.late / 3);
    }
    case StepAction::publish:
      return at(publish + timing_.late);
    case StepAction::publish_refresh:
      return std::max(free_ns_, refresh_ns_ + timing_.refresh);
    default:
      return std::max(free_ns_, planned.due_ns);
  }
}

void VirtualDaemon::advance(std::int64_t now_ns) {
  now_ns_ = now_ns;
  for (;;) {
    const PlannedAction planned = schedule_.next(free_ns_);
    const std::int64_t t = time_of(planned);
    if (planned.action == StepAction::begin && t >= settings_.stall_from && t < settings_.stall_to) {
      free_ns_ = settings_.stall_to;
      continue;
    }
    if (publishes(planned.action) ? t > now_ns : t >= now_ns) return deliver(now_ns);
    free_ns_ = t;
    if (planned.action == StepAction::begin) begun_ns_ = t;
    if (planned.action == StepAction::refresh) refresh_ns_ = t;
    if (settings_.before) settings_.before(planned.action, t);
    schedule_.perform(planned, *this);
    if (settings_.after) settings_.after(planned.action, t);
  }
}

VirtualDaemon::Edge::Edge(Instruments instruments, const std::vector<DeviceSettings>& devices,
                          const HapticOptions& options, const EachInstrument<bool>& at_simulation)
    : haptic(instruments, as_answered(devices, [&](int i) { return !at_simulation[i]; }), options, problems) {
  for (int i = 0; i < static_cast<int>(devices.size()); ++i)
    port[i].emplace(at_simulation[i] ? hands_there : hands_here, i,
                    in_scene(devices[static_cast<std::size_t>(i)]));
}

const DeviceState& VirtualDaemon::device_state(int i) const {
  return (edge_ && !settings_.at_simulation[i] ? edge_->haptic : haptic_).state().device[i];
}

// Each loop has its own devices' states, and the others' hands as the link told.
EachInstrument<ForceSample> VirtualDaemon::tick_both(const HapticInput& input) {
  const std::int64_t now = input.now_ns;
  if (halves_->hands.take(now, edge_->told_here.back())) edge_->told_here.publish();
  if (edge_->others.take(now, edge_->told_there.back())) edge_->told_there.publish();
  HapticInput here = input, there = input;
  for (int i = 0; i < haptic_.device_count(); ++i) {
    DeviceInput& remote = (settings_.at_simulation[i] ? there : here).device[i];
    remote.taken = edge_->port[i]->take(now, remote.sample);
    remote.presence = edge_->port[i]->presence();
  }
  EachInstrument<ForceSample> forces = haptic_.run(here);
  const EachInstrument<ForceSample> at_edge = edge_->haptic.run(there);
  for (int i = 0; i < haptic_.device_count(); ++i)
    if (!settings_.at_simulation[i]) forces[i] = at_edge[i];
  told_ = haptic_.instruments(now);
  edge_->others.send(halves_->link.hands(now), told_);
  halves_->hands.send(halves_->link.hands(now), edge_->haptic.instruments(now));
  return forces;
}

EachInstrument<ForceSample> VirtualDaemon::tick(const HapticInput& input) {
  advance(input.now_ns);
  if (edge_) return tick_both(input);
  const EachInstrument<ForceSample> forces = haptic_.run(input);
  tell(haptic_.instruments(input.now_ns));
  return forces;
}

// What of the simulation's has arrived.
void VirtualDaemon::deliver(std::int64_t now_ns) {
  std::unique_ptr<CondensedProblem> arrived;
  if (!halves_ || !halves_->problems.take(now_ns, arrived)) return;
  Channel<CondensedProblem>& there = edge_ ? edge_->problems : problems_;
  copy_in_use(*arrived, there.back());
  there.publish();
}

void VirtualDaemon::tell(const InstrumentInputs& instruments) {
  if (halves_)
    halves_->hands.send(halves_->link.hands(now_ns_), instruments);
  else
    told_ = instruments;
}

const CondensedProblem* VirtualDaemon::newest() {
  if (is_whole_loop_away()) return halves_->made.step > 0 ? &halves_->made : nullptr;
  return haptic_.newest();
}

InstrumentSamples VirtualDaemon::latch() {
  if (is_whole_loop_away()) halves_->hands.take(free_ns_, told_);
  return samples_of(told_);
}

void VirtualDaemon::publish(StepAction) {
  CondensedProblem& made = problem();
  made.published_ns = free_ns_;
  if (settings_.carried) settings_.carried(made);
  if (!halves_) {
    problems_.publish();
    return;
  }
  auto sent = std::make_unique<CondensedProblem>();
  copy_in_use(made, *sent);
  // Nearly those of a packed problem (edge_problem.h).
  const auto nodes = static_cast<std::size_t>(made.nodes);
  const std::size_t bytes = 9 * nodes * nodes + 12 * static_cast<std::size_t>(made.samples);
  halves_->problems.send(halves_->link.problem(free_ns_, bytes), std::move(sent));
  if (edge_) problems_.publish();
}

std::optional<ReferenceJob> VirtualDaemon::finished_reference() {
  const auto ready = std::find_if(references_.begin(), references_.end(),
                                  [&](const Reference& r) { return r.ready_ns <= free_ns_; });
  if (ready == references_.end()) return std::nullopt;
  ReferenceJob job = std::move(ready->job);
  references_.erase(ready);
  return job;
}

// Made at once, ready when a thread of its own would have been.
void VirtualDaemon::make_reference(ReferenceJob job) {
  try {
    if (settings_.make)
      settings_.make(*job.reference);
    else
      job.reference->make();
  } catch (const std::runtime_error&) {
    job.failed = true;
  }
  const std::int64_t takes = job.kind == JobKind::far_tissue ? timing_.far_tissue : timing_.reference;
  references_.push_back({begun_ns_ + takes, std::move(job)});
}

Pose to_device(const DeviceSettings& d, const Pose& X) {
  return {d.frame.conjugate() * ((X.p - d.origin) / d.position_scale),
          (d.frame.conjugate() * X.q * d.tool.conjugate()).normalized()};
}

}  // namespace hapticd
