#include "tools/offline/offline_run.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <utility>

#include "physics/tissue/tetrahedron.h"
#include "server/files/input_error.h"
#include "server/record/trajectory_reader.h"
#include "server/scene/scene_world.h"
#include "server/schedule/virtual_daemon.h"
#include "tools/offline/baseline_rendering.h"
#include "tools/offline/contact_laws.h"
#include "tools/offline/lone_hands.h"
#include "tools/offline/offline_parts.h"

namespace hapticd {

namespace {

constexpr std::int64_t first_ns = 1'000'000'000;

std::int64_t nanoseconds(double t) { return std::llround(1e9 * t); }

WorldSettings settings_of(const Scene& scene, const OfflineInput& input, const OfflineOptions& options) {
  WorldSettings settings = world_settings(scene);
  if (input.pedals != Pedals::all) settings.removal = {};
  settings.compliance_options.warping = options.warping;
  settings.newest_pose = options.newest_pose;
  settings.fresh_free_motion = options.fresh_free_motion;
  if (options.lead) settings.lead = *options.lead / scene.rate;
  if (options.tolerance > 0) settings.coulomb.tolerance = options.tolerance;
  return settings;
}

VirtualTiming timing_of(const OfflineOptions& options, const World& world) {
  VirtualTiming timing = usual_timing(world);
  if (options.latch_after) timing.latch = nanoseconds(*options.latch_after);
  timing.publish = nanoseconds(options.publish_after);
  if (options.interim_after) timing.interim = nanoseconds(*options.interim_after);
  timing.reference = nanoseconds(options.reference_after);
  return timing;
}

// The devices as they are, or with nothing between the contact's force and its answer. The motions are the
// instruments' own and the forces are on their tips, so no pivot turns them.
std::vector<DeviceSettings> devices_of(const Scene& scene, bool limits) {
  std::vector<DeviceSettings> devices = devices_of(scene);
  constexpr double none = 1e9;
  for (DeviceSettings& d : devices) {
    d.pivot.reset();
    if (!limits) d.max_force = d.max_torque = d.max_force_rate = d.max_speed = none;
  }
  return devices;
}

HapticOptions options_of(const Scene& scene, const OfflineOptions& o) {
  HapticOptions options = haptic_options(scene);
  // Who asks for another number gets them all.
  if (o.linearisations != options.contact.linearisations) options.contact.turned = 0;
  options.contact.linearisations = o.linearisations;
  if (!o.viscous) options.viscous.step = 0;
  if (o.tolerance > 0) options.contact.coulomb.tolerance = o.tolerance;
  if (o.sweeps_only > 0) {
    options.contact.coulomb.max_newton = 0;
    options.contact.coulomb.max_sweeps = o.sweeps_only;
    options.usable_residual = 1;  // an answer for as much work as was asked for, whatever it is worth
  }
  options.blend_time = o.blend_time;
  options.thinning_time = std::min(options.thinning_time, o.blend_time);
  options.passivity_control = o.passivity_control;
  if (o.limits) return options;
  constexpr std::int64_t never = std::int64_t{1} << 60;
  options.watchdog.problem_old_ns = options.watchdog.problem_lost_ns = never;
  options.watchdog.ramp_up_ns = 1;
  return options;
}

using OfflineTicks = EachInstrument<OfflineTick>;

// The daemon along the motions, and what its threads spend.
class Run {
 public:
  Run(const Scene& scene, const OfflineInput& input, const OfflineOptions& options, OfflineResult& result)
      : input_(input),
        result_(result),
        removals_(input.removals),
        period_(1 / scene.rate),
        pumps_(input),
        before_step_(options.before_step),
        solved_(options.rendering == Rendering::solved),
        interims_(solved_ || options.rendering == Rendering::alone),
        shapes_(shapes_of(scene)),
        local_(options.rendering, shapes_, haptic_options(scene).contact, 1 / scene.rate) {
    if (1 / scene.rate < offline::tick - offline::instant)
      throw std::invalid_argument("the simulation cannot be faster than the haptic loop");
    auto world = make_world(scene, settings_of(scene, input, options));
    VirtualDaemonSettings settings;
    settings.timing = timing_of(options, *world);
    settings.schedule.interims = options.interim_after && interims_;
    settings.schedule.refresh_at = settings.schedule.interims ? options.refresh_at : std::vector<double>{};
    settings.first_ns = first_ns;
    settings.carried = options.carried;
    settings.link = options.link;
    settings.before = [this](StepAction action, std::int64_t ns) { before(action, ns); };
    settings.after = [this](StepAction action, std::int64_t) { after(action); };
    settings.make = [this](ReferenceFactor& factor) {
      const double begun = offline::cpu_seconds();
      const offline::Cost cost(result_.bases, counts_);
      factor.make();
      making_ += offline::cpu_seconds() - begun;
    };
    const std::vector<DeviceSettings> devices = devices_of(scene, options.limits);
    if (options.rendering == Rendering::alone) alone_.emplace(shapes_, devices, options_of(scene, options));
    daemon_.emplace(std::move(world), scene.rate, devices, options_of(scene, options), settings);
  }

  OfflineTicks tick(double t, bool counts) {
    const std::int64_t now = first_ns + nanoseconds(t - input_.from + input_.settle);
    const InstrumentSamples samples = offline::instruments_at(input_, t);
    daemon_->advance(now);
    const bool swapped = std::exchange(swapped_, false);
    if (swapped && alone_) alone_->publish(*daemon_->newest(), daemon_->world().contact_scratch());
    if (swapped && !solved_ && !alone_)
      local_.publish(t, *daemon_->newest(), daemon_->schedule().report().contact);
    OfflineTicks out;
    {
      const offline::Cost cost(result_.haptic, counts);
      if (solved_)
        out = answered(now, t, samples, [&](const HapticInput& input) { return daemon_->tick(input); });
      else if (alone_)
        out = answered(now, t, samples, [&](const HapticInput& input) { return alone_->tick(input); });
      else
        out = local(t, samples);
    }
    if (solved_ && counts) look_at_tick();
    if (!solved_) {
      pumps_.run(t, offline::tick, shapes_, daemon_->schedule().report().occlusion);
      InstrumentInputs there;
      for (int i = 0; i < count(); ++i) {
        there[i].present = samples[i].present;
        there[i].X = samples[i].pose;
        there[i].received_ns = now;
        there[i].vacuum = pumps_[i];
      }
      daemon_->tell(there);
    }
    for (int i = 0; i < count(); ++i) {
      out[i].t = t;
      out[i].swapped = swapped;
    }
    return out;
  }

  int count() const { return static_cast<int>(shapes_.size()); }
  const World& world() const { return daemon_->world(); }

 private:
  void before(StepAction action, std::int64_t ns) {
    if (action == StepAction::begin) {
      const double t = input_.from - input_.settle + 1e-9 * static_cast<double>(ns - first_ns);
      counts_ = t >= input_.from - offline::instant;
      if (before_step_) before_step_(t, daemon_->world());
      removals_.apply(t, removal_lead, period_, daemon_->world());
      spent_ = 0;
    }
    if (action == StepAction::refresh) spent_ = 0;
    making_ = 0;
    begun_ = offline::cpu_seconds();
  }

  void after(StepAction action) {
    spent_ += offline::cpu_seconds() - begun_ - making_;
    const auto costs = [&](ThreadCost& of) {
      if (counts_) of.work.push_back(spent_);
    };
    swapped_ = swapped_ || action == StepAction::publish || action == StepAction::publish_interim ||
               action == StepAction::publish_refresh;
    if (action == StepAction::publish_interim) costs(result_.interim);
    if (action == StepAction::publish) look_at_step();
    if (action == StepAction::publish || action == StepAction::refresh) {
      costs(result_.simulation);
      if (counts_) result_.simulation.total += spent_;
    }
  }

  void look_at_step() {
    const StepReport& report = daemon_->schedule().report();
    result_.removed += report.removed;
    result_.inverted = std::max(result_.inverted, inverted_tets(daemon_->world().bodies()));
    result_.dropped_samples = std::max(result_.dropped_samples, daemon_->newest()->dropped_samples);
    if (counts_) result_.uncovered_nodes += report.uncovered_nodes;
    result_.capped += report.contact.status != SolveStatus::solved;
    if (count() > 1) {
      InstrumentPoses present;
      for (int i = 0; i < count(); ++i) present.present[i] = daemon_->told()[i].present;
      result_.reciprocity =
          std::max(result_.reciprocity, reciprocity_defect(*daemon_->newest(), shapes_, present));
    }
    result_.memory_bytes =
        std::max(result_.memory_bytes,
                 offline::compliance_bytes(report) + 3 * sizeof(CondensedProblem) + sizeof(HapticState));
  }

  void look_at_tick() {
    const HapticState& state = daemon_->haptic().state();
    if (!state.solved || state.solution.status == SolveStatus::not_finite) return;
    const CondensedProblem& solved =
        state.patch.step > 0 ? state.patch.problem : *daemon_->haptic().problem();
    result_.third_law = std::max(result_.third_law, third_law_defect(solved, state.scratch, state.solution));
  }

  OfflineTicks local(double t, const InstrumentSamples& samples) {
    const EachInstrument<Vec6> wrench = local_.wrench(t, poses_of(samples));
    OfflineTicks out;
    for (int i = 0; i < count(); ++i) out[i].wrench = wrench[i];
    return out;
  }

  // tick: what makes answers of all devices' states.
  template <typename Tick>
  OfflineTicks answered(std::int64_t now, double t, const InstrumentSamples& samples, const Tick& tick) {
    HapticInput input;
    input.now_ns = now;
    const bool first = count_++ == 0;
    for (int i = 0; i < count(); ++i) {
      if (!samples[i].present) continue;
      DeviceInput& device = input.device[i];
      device.presence = {.connected = true, .new_client = first, .conflict = false};
      device.taken = true;
      device.sample.sequence = count_;
      device.sample.client_time_ns = device.sample.received_ns = now;
      device.sample.pose = to_device(daemon_->haptic().device(i), samples[i].pose);
      device.sample.buttons = offline::pedals_at(input_, i, t);
      device.sample.enable = true;
    }
    const EachInstrument<ForceSample> answers = tick(input);
    OfflineTicks out;
    bool capped = false;
    for (int i = 0; i < count(); ++i) {
      const DeviceSettings& device = daemon_->haptic().device(i);
      const ForceSample& answer = answers[i];
      out[i].wrench.head<3>() = device.frame * answer.force / device.force_scale;
      out[i].wrench.tail<3>() = device.frame * answer.torque * (device.position_scale / device.force_scale);
      out[i].penetration = answer.penetration;
      out[i].residual = answer.residual;
      out[i].active = static_cast<int>(answer.active);
      capped = capped || (answer.status & status_solver_cap) != 0;
    }
    result_.capped += capped;
    return out;
  }

  const OfflineInput& input_;
  OfflineResult& result_;
  offline::Removals removals_;
  double period_;  // of a simulation step [s]
  offline::Pumps pumps_;
  const std::function<void(double, const World&)> before_step_;
  const bool solved_, interims_;
  const std::vector<Instrument> shapes_;
  LocalModel local_;
  std::optional<LoneHands> alone_;
  std::optional<VirtualDaemon> daemon_;
  std::uint64_t count_ = 0;
  bool swapped_ = false;                       // since the tick before
  bool counts_ = false;                        // the step under way is in the window
  double begun_ = 0, spent_ = 0, making_ = 0;  // of the action, the step, the reference factors in it [s]
};

}  // namespace

double ThreadCost::quantile(double percent) const {
  if (work.empty()) return 0;
  std::vector<double> sorted = work;
  std::sort(sorted.begin(), sorted.end());
  const auto rank = static_cast<std::size_t>(std::ceil(percent / 100 * static_cast<double>(sorted.size())));
  return sorted[std::clamp<std::size_t>(rank, 1, sorted.size()) - 1];
}

int inverted_tets(const Bodies& bodies) {
  int inverted = 0;
  for (const Body& body : bodies) {
    if (!body.deformable || body.asleep) continue;
    for (int t = 0; t < body.model.tet_count(); ++t) {
      if (!body.state.alive[t]) continue;
      const Tet& n = body.model.mesh.tets[t];
      const auto& x = body.state.x;
      inverted += (x[n[1]] - x[n[0]]).cross(x[n[2]] - x[n[0]]).dot(x[n[3]] - x[n[0]]) <= 0;
    }
  }
  return inverted;
}

OfflineResult run_offline(const Scene& scene, const OfflineInput& input, const OfflineOptions& options,
                          const OfflineProgress& progress) {
  OfflineResult result;
  Run run(scene, input, options, result);
  const auto settle = static_cast<int>(std::lround(input.settle / offline::tick));
  const auto ticks = settle + static_cast<int>(std::lround((input.to - input.from) / offline::tick));
  for (int i = 0; i < ticks; ++i) {
    const double t = input.from + offline::tick * (i - settle);
    const OfflineTicks out = run.tick(t, i >= settle);
    for (int k = 0; i >= settle && k < run.count(); ++k) result.hands[k].push_back(out[k]);
    if (progress && !progress(static_cast<double>(i + 1) / ticks)) break;
  }
  result.cut_area = run.world().cutting().area();
  return result;
}

OfflineInput along_trajectories(const Scene& scene, const std::string& why) {
  OfflineInput input;
  input.to = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < scene.instruments.size(); ++i) {
    const SceneInstrument& held = scene.instruments[i];
    if (!held.trajectory) throw InputError(scene.file, 0, "trajectory", "is needed: " + why);
    std::vector<TrajectorySample> samples = read_trajectory(*held.trajectory, LengthUnit::metre).samples;
    for (TrajectorySample& s : samples) s.pose = to_scene(held.device, s.pose);
    const Trajectory motion = make_trajectory(std::move(samples));
    input.from = i == 0 ? motion.begin() : std::max(input.from, motion.begin());
    input.to = std::min(input.to, motion.end());
    input.motion[static_cast<int>(i)] = motion;
  }
  return input;
}

}  // namespace hapticd
