#include "server/plan/model_trial.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <memory>
#include <stdexcept>
#include <utility>

#include "server/scene/scene_world.h"
#include "server/schedule/virtual_daemon.h"

namespace hapticd {
namespace {

constexpr double tick = 1e-3;     // [s]
constexpr double settled = 0.1;   // [s]
constexpr double instant = 1e-9;  // [s]
constexpr int approach_parts =
    4;  // a way that takes a pilot one step takes the reference so many shorter ones
constexpr double latch_share = 0.6;  // of a step's cost that has passed when the pose is latched

double cpu_ms() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

double quantile(std::vector<double> v, double share) {
  if (v.empty()) return 0;
  std::sort(v.begin(), v.end());
  return v[static_cast<std::size_t>(share * static_cast<double>(v.size() - 1))];
}

InstrumentSample sample_of(const PilotStroke& stroke, double t) {
  InstrumentSample sample;
  const auto i = static_cast<std::ptrdiff_t>(std::lround(t / tick));
  sample.pose =
      stroke.pose[std::clamp<std::ptrdiff_t>(i, 0, static_cast<std::ptrdiff_t>(stroke.pose.size()) - 1)];
  sample.present = true;
  return sample;
}

void spread_to_touching(const Scene& scene, std::vector<std::uint8_t>& pressed) {
  for (std::size_t round = 0; round < scene.bodies.size(); ++round)
    for (const ContactPair& p : scene.contacts)
      pressed[p.points] = pressed[p.faces] = pressed[p.points] | pressed[p.faces];
}

// With nothing between the contact's force and its answer. The stroke is the first one's; nobody holds the others.
std::vector<DeviceSettings> wide_devices_of(const Scene& scene) {
  std::vector<DeviceSettings> devices = devices_of(scene);
  constexpr double none = 1e9;
  for (DeviceSettings& d : devices) d.max_force = d.max_torque = d.max_force_rate = d.max_speed = none;
  return devices;
}

HapticOptions options_of(const Scene& scene) {
  HapticOptions options = haptic_options(scene);
  options.blend_time = options.thinning_time = 0;
  constexpr std::int64_t never = std::int64_t{1} << 60;
  options.watchdog.problem_old_ns = options.watchdog.problem_lost_ns = never;
  options.watchdog.ramp_up_ns = 1;
  return options;
}

class Pilot {
 public:
  Pilot(const Scene& scene, const PilotStroke& stroke)
      : stroke_(stroke),
        h_(1 / scene.rate),
        begin_(-settled - h_ * static_cast<double>(stroke.approach.size())),
        daemon_(make_world(scene), scene.rate, wide_devices_of(scene), options_of(scene), settings()) {
    run_.pressed.assign(scene.bodies.size(), 0);
  }

  TrialRun run(const Scene& scene) {
    const auto ticks = static_cast<std::ptrdiff_t>(stroke_.pose.size());
    for (auto i = static_cast<std::ptrdiff_t>(std::floor(begin_ / tick)); i < ticks; ++i)
      feel(tick * static_cast<double>(i), i >= 0);
    run_.step_ms = quantile(step_ms_, 0.5);
    run_.worst_step_ms = quantile(step_ms_, 0.9);
    run_.tick_ms = quantile(tick_ms_, 0.5);
    double sum = reference_ms_;
    for (const double ms : step_ms_) sum += ms;
    run_.cost_ms = sum / static_cast<double>(std::max<std::size_t>(1, step_ms_.size())) +
                   all_ticks_ms_ / static_cast<double>(ticks) * h_ / tick;
    spread_to_touching(scene, run_.pressed);
    return run_;
  }

 private:
  static constexpr std::int64_t first_ns = 1'000'000'000;

  VirtualDaemonSettings settings() {
    VirtualDaemonSettings s;
    s.first_ns = first_ns;
    s.before = [this](StepAction action, std::int64_t ns) {
      if (action == StepAction::begin) begin_step(ns);
      making_ms_ = 0;
      action_begun_ = cpu_ms();
    };
    s.after = [this](StepAction action, std::int64_t) {
      spent_ms_ += cpu_ms() - action_begun_ - making_ms_;
      swapped_ = swapped_ || action == StepAction::publish;
      if (action == StepAction::publish) (counts_ ? step_ms_ : warm_up_ms_).push_back(spent_ms_);
    };
    s.make = [this](ReferenceFactor& reference) {
      const double begun = cpu_ms();
      reference.make();
      making_ms_ += cpu_ms() - begun;
      if (counts_) reference_ms_ += cpu_ms() - begun;
    };
    return s;
  }

  void begin_step(std::int64_t ns) {
    counts_ = begin_ + 1e-9 * static_cast<double>(ns - first_ns) >= -instant;
    spent_ms_ = 0;
    const double usual = quantile(step_ms_.empty() ? warm_up_ms_ : step_ms_, 0.5);
    const double late = std::clamp(std::ceil(usual), 1.0, h_ / tick) * tick;
    VirtualTiming timing;
    timing.latch = std::llround(1e9 * latch_share * late);
    timing.publish = std::llround(1e9 * late);
    timing.reference = 0;  // the next step has it
    daemon_.set_timing(timing);
  }

  void feel(double t, bool counts) {
    HapticInput input;
    input.now_ns = first_ns + std::llround(1e9 * (t - begin_));
    if (input.now_ns < first_ns) return;
    daemon_.advance(input.now_ns);
    if (t < -settled - instant) {  // on the way there nobody feels anything
      const auto k = static_cast<std::size_t>((t - begin_ + instant) / h_);
      InstrumentInput there;
      there.present = true;
      there.X = stroke_.approach[std::min(k, stroke_.approach.size() - 1)];
      there.received_ns = input.now_ns;
      daemon_.tell(there);
      return;
    }
    input.device[0].presence = {.connected = true, .new_client = count_ == 0, .conflict = false};
    input.device[0].taken = true;
    input.device[0].sample.sequence = ++count_;
    input.device[0].sample.client_time_ns = input.device[0].sample.received_ns = input.now_ns;
    input.device[0].sample.pose = to_device(daemon_.haptic().device(), sample_of(stroke_, t).pose);
    input.device[0].sample.enable = true;
    const bool swapped = std::exchange(swapped_, false);
    const double begun = cpu_ms();
    const ForceSample answer = daemon_.tick(input)[0];
    if (!counts) return;
    const double ms = cpu_ms() - begun;
    all_ticks_ms_ += ms;
    if (answer.active > 0) tick_ms_.push_back(ms);
    const DeviceSettings& device = daemon_.haptic().device();
    run_.force.push_back(device.frame * answer.force / device.force_scale);
    run_.swapped.push_back(swapped);
    const HapticState& state = daemon_.haptic().state();
    if (!state.solved) return;
    const ContactRows& rows = state.scratch.rows;
    for (int i = 0; i < rows.contacts; ++i)
      if (rows.row[i].sample >= 0 &&
          state.scratch.lambda[static_cast<std::size_t>(rows.rows_per_contact) * i] > 0)
        run_.pressed[rows.row[i].id >> 56] = 1;
  }

  const PilotStroke& stroke_;
  const double h_, begin_;  // … of the approach [s]
  VirtualDaemon daemon_;
  std::uint64_t count_ = 0;
  bool counts_ = false, swapped_ = false;
  double action_begun_ = 0, spent_ms_ = 0, making_ms_ = 0;
  std::vector<double> warm_up_ms_, step_ms_, tick_ms_;
  double all_ticks_ms_ = 0, reference_ms_ = 0;
  TrialRun run_;
};

}  // namespace

TrialRun run_pilot(const Scene& scene, const PilotStroke& stroke) {
  try {
    return Pilot(scene, stroke).run(scene);
  } catch (const std::runtime_error&) {  // a singular body
    return {};
  }
}

TrialRun run_reference(const Scene& scene, const PilotStroke& stroke, int every_ms) {
  Scene single = scene;
  single.rate = 1 / (every_ms * tick);
  single.contact = Renewal::renewed;
  TrialRun run;
  std::vector<double> step_ms;
  try {
    WorldSettings settings = world_settings(single);
    settings.compliance_options.synchronous_reference = true;
    settings.linearisations = 6;
    const std::unique_ptr<World> world = make_world(single, settings);
    const auto problem = std::make_unique<CondensedProblem>();
    world->step([] { return InstrumentSample{}; }, *problem);
    for (std::size_t i = 1; i < stroke.approach.size(); ++i)
      for (int k = 1; k <= approach_parts; ++k)
        world->step(
            [&] {
              const Pose &a = stroke.approach[i - 1], &b = stroke.approach[i];
              const double s = static_cast<double>(k) / approach_parts;
              return InstrumentSample{{a.p + s * (b.p - a.p), a.q.slerp(s, b.q)}, true, false, false};
            },
            *problem);
    const auto ticks = static_cast<int>(stroke.pose.size());
    const auto before = static_cast<int>(std::lround(settled / tick)) / every_ms;
    for (int i = -before; i * every_ms < ticks; ++i) {
      const double begun = cpu_ms();
      const StepReport report = world->step([&] { return sample_of(stroke, tick * i * every_ms); }, *problem);
      step_ms.push_back(cpu_ms() - begun);
      for (ReferenceJob& job : world->wanted_references()) {
        job.reference->make();
        world->adopt(std::move(job));
      }
      if (i >= 0) run.force.push_back(report.contact.wrench[0].head<3>());
    }
  } catch (const std::runtime_error&) {
    return {};
  }
  run.step_ms = quantile(step_ms, 0.5);
  return run;
}

double force_error(const TrialRun& reference, const TrialRun& run, int every_ms) {
  if (run.force.empty()) return std::numeric_limits<double>::infinity();
  double squares = 0, peak = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < reference.force.size() && i * every_ms < run.force.size(); ++i, ++count) {
    const Vec3 difference = run.force[i * every_ms] - reference.force[i];
    if (!difference.allFinite()) return std::numeric_limits<double>::infinity();
    squares += difference.squaredNorm();
    peak = std::max(peak, reference.force[i].norm());
  }
  return peak > 0 ? std::sqrt(squares / static_cast<double>(count)) / peak : 0;
}

double swap_jump(std::span<const Vec3> reference, int every_ms, std::span<const Vec3> force,
                 std::span<const std::uint8_t> swapped) {
  double squares = 0, peak = 0;
  std::size_t count = 0;
  for (const Vec3& f : reference) peak = std::max(peak, f.norm());
  const auto every = static_cast<std::size_t>(every_ms);
  for (std::size_t i = 1; i < force.size(); ++i) {
    const std::size_t before = (i - 1) / every;
    if (!swapped[i] || before + 1 >= reference.size()) continue;
    const Vec3 change = (reference[before + 1] - reference[before]) / every_ms;
    squares += (force[i] - force[i - 1] - change).squaredNorm();
    ++count;
  }
  return count > 0 && peak > 0 ? std::sqrt(squares / static_cast<double>(count)) / peak : 0;
}

double felt_error(double error, double jump, double jump_of_whole) {
  return std::hypot(error, std::max(0.0, jump - jump_of_whole));
}

}  // namespace hapticd
