#include "tools/offline/virtual_daemon.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "server/scene/scene_world.h"

namespace hapticd {

namespace {

constexpr double tick_s = 1e-3;
constexpr double refresh_takes = 2e-3;  // from its pose until it is in use [s]
constexpr double instant = 1e-9;        // times closer than this are the same [s]
constexpr std::int64_t first_ns = 1'000'000'000;

std::int64_t in_ns(double t) { return first_ns + static_cast<std::int64_t>(1e9 * t + 0.5); }

std::unique_ptr<World> world_of(const Scene& scene, const VirtualDaemonOptions& options) {
  WorldSettings settings = world_settings(scene);
  if (options.sweeps_only > 0) {
    settings.coulomb.max_newton = 0;
    settings.coulomb.max_sweeps = options.sweeps_only;
  }
  return make_world(scene, settings);
}

}  // namespace

VirtualDaemon::VirtualDaemon(const Scene& scene, const VirtualDaemonOptions& options)
    : device_(scene.device),
      instrument_(scene.instrument),
      haptic_(haptic_options(scene)),
      options_(options),
      h_(1 / scene.rate),
      world_(world_of(scene, options)),
      local_(options.rendering, instrument_, haptic_.contact, h_) {
  haptic_.passivity_control = options.passivity_control;
  haptic_.blend_time = options.blend_time.value_or(haptic_.blend_time);
  if (options.sweeps_only > 0) {
    haptic_.contact.coulomb.max_newton = 0;
    haptic_.contact.coulomb.max_sweeps = options.sweeps_only;
    haptic_.usable_residual = 1e300;
  }
  if (!options.watchdogs) {
    constexpr std::int64_t never = std::int64_t{1} << 60;
    WatchdogLimits& w = haptic_.watchdog;
    w.hold_after_ns = w.ramp_after_ns = w.disarm_after_ns = w.problem_old_ns = w.problem_lost_ns = never;
  }
  // As the daemon does before its clock starts.
  world_->step([] { return InstrumentSample{}; }, *in_use_);
  in_use_->published_ns = first_ns;
}

InstrumentSample VirtualDaemon::known_at(double t) const {
  const auto after =
      std::find_if(known_.begin(), known_.end(), [&](const Known& k) { return k.t > t + instant; });
  return after == known_.begin() ? InstrumentSample{} : std::prev(after)->sample;
}

void VirtualDaemon::step(double begin) {
  for (; !bases_.empty() && bases_.front().step <= steps_; bases_.pop_front())
    world_->adopt(std::move(bases_.front().job));
  const double latch = begin + std::min(options_.latch_after, h_ - tick_s);
  bool latched = false;
  const auto interim = [&]() -> CondensedProblem& {
    std::swap(in_use_, next_);
    in_use_->published_ns = in_ns(latch);
    return *next_;
  };
  contact_ =
      world_->step([&] { return known_at(std::exchange(latched, true) ? latch : begin); }, *next_, interim)
          .contact;
  for (ReferenceJob& job : world_->wanted_references()) {
    try {
      job.reference->make();
    } catch (const std::runtime_error&) {
      job.failed = true;
    }
    bases_.push_back({steps_ + options_.reference_steps, std::move(job)});
  }
  ++steps_;
}

// The problem in use made again, to be in use from then on.
void VirtualDaemon::refresh(double use) {
  if (!world_->refresh(known_at(use - refresh_takes), *next_)) return;
  std::swap(in_use_, next_);
  in_use_->published_ns = in_ns(use);
}

void VirtualDaemon::advance(double t) {
  for (;;) {
    if (!refreshes_.empty() && refreshes_.front() <= t + instant) {
      refresh(refreshes_.front());
      refreshes_.pop_front();
      continue;
    }
    if (!stepped_ && options_.stall_for > 0 && begin_ >= options_.stall_from - instant &&
        begin_ < options_.stall_from + options_.stall_for - instant)
      begin_ = options_.stall_from + options_.stall_for;
    const double published = begin_ + std::min(options_.publish_after, h_);
    if (!stepped_) {
      // The tick of the latch itself counts as known.
      const double latched = begin_ + std::min(options_.latch_after, h_ - tick_s);
      if (published > t + instant && latched > t - instant) return;
      step(begin_);
      stepped_ = true;
    }
    if (published > t + instant) return;
    std::swap(in_use_, next_);
    in_use_->published_ns = in_ns(published);
    local_.publish(published, *in_use_, contact_);
    stepped_ = false;
    for (const double at : options_.refresh_at)
      if (begin_ + at * h_ >= published - instant && at * h_ + refresh_takes <= h_ + instant)
        refreshes_.push_back(begin_ + at * h_ + refresh_takes);
    begin_ += h_;
    while (known_.size() > 2 && known_[1].t <= begin_ - instant) known_.pop_front();
  }
}

ForceSample VirtualDaemon::baseline(const DeviceSample& sample, double t) {
  const Pose X = to_scene(device_, sample.pose);
  const Vec6 w = local_.wrench(t, X);
  bool hit = false;
  const Wrench wrench = saturated(
      device_, {force_to_device(device_, w.head<3>()), torque_to_device(device_, w.tail<3>())}, hit);
  ForceSample answer;
  answer.force = wrench.force;
  answer.torque = wrench.torque;
  answer.status = hit ? std::uint32_t{status_saturated} : 0u;
  return answer;
}

ForceSample VirtualDaemon::tick(const DeviceSample* arrived) {
  const double t = tick_s * static_cast<double>(count_);
  advance(t);
  HapticInput input;
  input.now_ns = in_ns(t);
  input.presence = {.connected = true, .new_client = count_ == 0, .conflict = false};
  input.taken = arrived != nullptr;
  if (arrived) {
    newest_ = *arrived;
    newest_.received_ns = newest_.client_time_ns = input.now_ns;
    input.sample = newest_;
  }
  ++count_;
  const ForceSample answer = haptic_step(in_use_.get(), instrument_, device_, haptic_, input, *state_);
  const InstrumentInput told = instrument_input(device_, haptic_.watchdog, state_->watchdog, input.now_ns);
  known_.push_back({t,
                    {told.X, told.present, (told.buttons & pedal_phaco) != 0,
                     (told.buttons & pedal_aspiration) != 0, 1e-9 * static_cast<double>(told.received_ns)}});
  if (options_.rendering == Rendering::solved) return answer;
  ForceSample other = baseline(newest_, t);
  other.step = answer.step;
  return other;
}

ForceSample SpringWall::tick(const DeviceSample* arrived) {
  if (!arrived) return last_;
  const double depth = normal_.dot(point_ - arrived->pose.p);
  const double rate = has_depth_ ? (depth - depth_) / tick_s : 0;
  depth_ = depth;
  has_depth_ = true;
  last_.status = 0;
  last_.force =
      depth > 0 ? Vec3(std::max(0.0, stiffness_ * (depth + damping_time_ * rate)) * normal_) : Vec3::Zero();
  return last_;
}

}  // namespace hapticd
