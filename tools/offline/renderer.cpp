#include "tools/offline/renderer.h"

#include <cmath>

#include "server/scene/scene_world.h"

namespace hapticd {

namespace {

constexpr double tick_s = 1e-3;
constexpr std::int64_t first_ns = 1'000'000'000;

std::int64_t nanoseconds(double t) { return std::llround(1e9 * t); }

std::unique_ptr<World> world_of(const Scene& scene, const DaemonRendererOptions& options) {
  WorldSettings settings = world_settings(scene);
  if (options.sweeps_only > 0) {
    settings.coulomb.max_newton = 0;
    settings.coulomb.max_sweeps = options.sweeps_only;
  }
  return make_world(scene, settings);
}

HapticOptions haptic_of(const Scene& scene, const DaemonRendererOptions& options) {
  HapticOptions haptic = haptic_options(scene);
  haptic.passivity_control = options.passivity_control;
  haptic.blend_time = options.blend_time.value_or(haptic.blend_time);
  haptic.thinning_time = std::min(haptic.thinning_time, haptic.blend_time);
  if (options.problem_old > 0) let_problems_grow_old(haptic.watchdog, options.problem_old);
  if (options.sweeps_only > 0) {
    haptic.contact.coulomb.max_newton = 0;
    haptic.contact.coulomb.max_sweeps = options.sweeps_only;
    haptic.usable_residual = 1e300;
  }
  if (!options.watchdogs) {
    constexpr std::int64_t never = std::int64_t{1} << 60;
    WatchdogLimits& w = haptic.watchdog;
    w.hold_after_ns = w.ramp_after_ns = w.disarm_after_ns = w.problem_old_ns = w.problem_lost_ns = never;
  }
  return haptic;
}

}  // namespace

DaemonRenderer::DaemonRenderer(const Scene& scene, const DaemonRendererOptions& options)
    : options_(options),
      daemon_(world_of(scene, options), scene.rate, scene.first().device, haptic_of(scene, options),
              settings()),
      local_(options.rendering, daemon_.world().instruments(), haptic_options(scene).contact,
             1 / scene.rate) {
  timing_ = usual_timing(daemon_.world());
  timing_.publish = nanoseconds(options.publish_after);
  timing_.reference = nanoseconds(options.reference_steps / scene.rate);
  daemon_.set_timing(timing_);
}

VirtualDaemonSettings DaemonRenderer::settings() {
  VirtualDaemonSettings s;
  s.first_ns = first_ns;
  s.link = options_.link;
  if (options_.stall_for > 0) {
    s.stall_from = first_ns + nanoseconds(options_.stall_from);
    s.stall_to = s.stall_from + nanoseconds(options_.stall_for);
  }
  s.before = [this](StepAction action, std::int64_t) {
    if (options_.late) options_.late->before(action, timing_, daemon_);
  };
  s.after = [this](StepAction action, std::int64_t ns) {
    if (action == StepAction::begin && options_.begun) options_.begun();
    if (action == StepAction::publish && options_.published) options_.published();
    if (action == StepAction::publish && options_.rendering != Rendering::solved)
      local_.publish(1e-9 * static_cast<double>(ns - first_ns), *daemon_.newest(),
                     daemon_.schedule().report().contact);
  };
  return s;
}

ForceSample DaemonRenderer::baseline(std::int64_t now_ns) {
  const DeviceSettings& device = daemon_.haptic().device();
  const Pose X = to_scene(device, newest_.pose);
  const Vec6 w = local_.wrench(1e-9 * static_cast<double>(now_ns - first_ns), X)[0];
  return baseline_answer(device, newest_.pose, w);
}

ForceSample DaemonRenderer::tick(const DeviceSample* arrived) {
  HapticInput input;
  input.now_ns = first_ns + count_ * nanoseconds(tick_s);
  input.device[0].presence = {.connected = true, .new_client = count_ == 0, .conflict = false};
  input.device[0].taken = arrived != nullptr;
  if (arrived) {
    newest_ = *arrived;
    newest_.received_ns = newest_.client_time_ns = input.now_ns;
    input.device[0].sample = newest_;
  }
  ++count_;
  const ForceSample answer = daemon_.tick(input)[0];
  if (options_.rendering == Rendering::solved) return answer;
  ForceSample other = baseline(input.now_ns);
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
