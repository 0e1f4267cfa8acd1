#include "tools/offline/offline_run.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <stdexcept>
#include <utility>

#include "haptic/haptic_step.h"
#include "physics/tissue/tetrahedron.h"
#include "server/scene/scene_world.h"
#include "tools/offline/baseline_rendering.h"
#include "tools/offline/offline_parts.h"

namespace hapticd {

namespace {

constexpr double refresh_takes = 2e-3;  // from its pose until it is in use [s]
constexpr std::int64_t first_ns = 1'000'000'000;

// The simulation thread in virtual time.
class Simulation {
 public:
  Simulation(const Scene& scene, const OfflineInput& input, const OfflineOptions& options,
             OfflineResult& result)
      : input_(input), options_(options), result_(result), removals_(input.removals), h_(1 / scene.rate) {
    if (h_ < offline::tick - offline::instant)
      throw std::invalid_argument("the simulation cannot be faster than the haptic loop");
    WorldSettings settings = world_settings(scene);
    settings.compliance_options.warping = options.warping;
    settings.newest_pose = options.newest_pose;
    settings.fresh_free_motion = options.fresh_free_motion;
    if (options.lead) settings.lead = *options.lead * h_;
    const bool ahead = settings.lead > 0 && settings.contact == Renewal::renewed && options.fresh_free_motion;
    latch_ = std::min(options.latch_after.value_or(ahead ? 1e-3 : 6e-3), h_ - offline::tick);
    removal_latch_ = std::min(4e-3, h_ - offline::tick);
    if (options.tolerance > 0) settings.coulomb.tolerance = options.tolerance;
    world_ = make_world(scene, settings);
    // As the daemon does before its clock starts.
    world_->step([] { return InstrumentSample{}; }, *in_use_);
    interims_ = options.interim_after && options.rendering == Rendering::solved;
    begin_ = input.from - input.settle;
  }

  // Steps until the newest problem in use at `t` is there. True if it is another than before.
  bool advance(double t) {
    bool swapped = false;
    const double publish = std::min(options_.publish_after, h_);
    const double interim = interims_ ? std::min(*options_.interim_after, publish) : publish;
    for (;;) {
      if (!refreshes_.empty() && refreshes_.front() <= t + offline::instant) {
        const double from = refreshes_.front();
        refreshes_.pop_front();
        swapped = refresh(from) || swapped;
        continue;
      }
      if (!stepped_ && begin_ + interim <= t + offline::instant) {
        swapped = step(begin_) || swapped;
        stepped_ = true;
      }
      if (!stepped_ || begin_ + publish > t + offline::instant) return swapped;
      std::swap(in_use_, next_);
      in_use_->published_ns = in_ns(begin_ + publish);
      swapped = true;
      stepped_ = false;
      for (const double at : options_.refresh_at)
        if (interims_ && at * h_ >= publish - offline::instant &&
            at * h_ + refresh_takes <= h_ + offline::instant)
          refreshes_.push_back(begin_ + at * h_ + refresh_takes);
      begin_ = input_.from - input_.settle + static_cast<double>(++count_) * h_;
    }
  }

  const World& world() const { return *world_; }
  const CondensedProblem& problem() const { return *in_use_; }
  const StepReport& report() const { return report_; }
  double period() const { return h_; }

 private:
  struct Base {
    double ready;
    ReferenceJob job;
  };

  // True if an interim problem is in use now; `next_` is for later.
  bool step(double t) {
    const bool counts = t >= input_.from - offline::instant;
    adopt_references(t);
    const double latch =
        removals_.apply_until(t + removal_lead, *world_) ? std::max(latch_, removal_latch_) : latch_;
    bool latched = false;
    const double begun = offline::cpu_seconds();
    const std::function<CondensedProblem&()> interim = [&]() -> CondensedProblem& {
      if (counts) result_.interim.work.push_back(offline::cpu_seconds() - begun);
      std::swap(in_use_, next_);
      in_use_->published_ns = in_ns(t + std::min(*options_.interim_after, options_.publish_after));
      return *next_;
    };
    {
      const offline::Cost cost(result_.simulation, counts);
      report_ = world_->step(
          [&] { return offline::instrument_at(input_, std::exchange(latched, true) ? t + latch : t); },
          *next_, interims_ ? interim : nullptr);
    }
    for (ReferenceJob& job : world_->wanted_references()) {
      const offline::Cost cost(result_.bases, counts);
      try {
        job.reference->make();
      } catch (const std::runtime_error&) {
        job.failed = true;
      }
      bases_.push_back({t + options_.reference_after, std::move(job)});
    }
    result_.removed += report_.removed;
    result_.inverted = std::max(result_.inverted, inverted_tets(world_->bodies()));
    result_.dropped_samples = std::max(result_.dropped_samples, next_->dropped_samples);
    result_.capped += report_.contact.status != SolveStatus::solved;
    result_.memory_bytes =
        std::max(result_.memory_bytes,
                 offline::compliance_bytes(report_) + 3 * sizeof(CondensedProblem) + sizeof(HapticState));
    return report_.interim;
  }

  // The problem in use made again, to be in use from `t` on. True if it is.
  bool refresh(double t) {
    const offline::Cost cost(result_.simulation, t >= input_.from - offline::instant);
    if (!world_->refresh(offline::instrument_at(input_, t - refresh_takes), *next_)) return false;
    std::swap(in_use_, next_);
    in_use_->published_ns = in_ns(t);
    return true;
  }

  // Of the haptic loop's clock.
  std::int64_t in_ns(double t) const {
    return first_ns + std::llround(1e9 * (t - input_.from + input_.settle));
  }

  void adopt_references(double t) {
    for (; !bases_.empty() && bases_.front().ready <= t + offline::instant; bases_.pop_front())
      world_->adopt(std::move(bases_.front().job));
  }

  const OfflineInput& input_;
  const OfflineOptions& options_;
  OfflineResult& result_;
  offline::Removals removals_;
  const double h_;
  double latch_ = 0;
  double removal_latch_ = 0;  // where the factor comes first
  double begin_ = 0;          // of the step to come [s]
  std::int64_t count_ = 0;
  std::unique_ptr<World> world_;
  std::unique_ptr<CondensedProblem> in_use_ = std::make_unique<CondensedProblem>();
  std::unique_ptr<CondensedProblem> next_ = std::make_unique<CondensedProblem>();
  bool interims_ = true;
  bool stepped_ = false;  // `next_` is of the step that begins at `begin_`
  StepReport report_;
  std::deque<Base> bases_;
  std::deque<double> refreshes_;  // when problems made again come into use [s]
};

// The device as it is, or with nothing between the contact's force and its answer.
DeviceSettings device_of(const Scene& scene, bool limits) {
  DeviceSettings device = scene.device;
  if (limits) return device;
  constexpr double none = 1e9;
  device.max_force = device.max_torque = device.max_force_rate = device.max_speed = none;
  return device;
}

HapticOptions options_of(const Scene& scene, const OfflineOptions& o) {
  HapticOptions options = haptic_options(scene);
  options.contact.linearisations = o.linearisations;
  if (!o.viscous) options.viscous.step = 0;
  if (o.tolerance > 0) options.contact.coulomb.tolerance = o.tolerance;
  if (o.sweeps_only > 0) {
    options.contact.coulomb.max_newton = 0;
    options.contact.coulomb.max_sweeps = o.sweeps_only;
    options.usable_residual = 1;  // an answer for as much work as was asked for, whatever it is worth
  }
  options.blend_time = o.blend_time;
  if (o.limits) return options;
  constexpr std::int64_t never = std::int64_t{1} << 60;
  options.watchdog.problem_old_ns = options.watchdog.problem_lost_ns = never;
  options.watchdog.ramp_up_ns = 1;
  return options;
}

OfflineTick tick_of(const Vec6& wrench) {
  OfflineTick out;
  out.wrench = wrench;
  return out;
}

// The haptic thread in virtual time.
class Haptics {
 public:
  Haptics(const Scene& scene, const OfflineOptions& options)
      : instrument_(scene.instrument),
        device_(device_of(scene, options.limits)),
        options_(options_of(scene, options)) {}

  OfflineTick step(const CondensedProblem& problem, const Pose& X) {
    HapticInput input;
    input.now_ns = now_ns_;
    input.presence = {.connected = true, .new_client = count_ == 0, .conflict = false};
    input.taken = true;
    input.sample.sequence = ++count_;
    input.sample.client_time_ns = input.sample.received_ns = now_ns_;
    input.sample.pose = to_device(X);
    input.sample.enable = true;
    now_ns_ += options_.watchdog.period_ns;
    const ForceSample answer = haptic_step(&problem, instrument_, device_, options_, input, *state_);
    OfflineTick out;
    out.wrench.head<3>() = device_.frame * answer.force / device_.force_scale;
    out.wrench.tail<3>() = device_.frame * answer.torque * (device_.position_scale / device_.force_scale);
    out.penetration = answer.penetration;
    out.residual = answer.residual;
    out.active = static_cast<int>(answer.active);
    capped_ += (answer.status & status_solver_cap) != 0;
    return out;
  }

  int capped() const { return capped_; }

 private:
  // The inverse of `to_scene`.
  Pose to_device(const Pose& X) const {
    return {device_.frame.conjugate() * (X.p - device_.origin) / device_.position_scale,
            (device_.frame.conjugate() * X.q * device_.tool.conjugate()).normalized()};
  }

  const Instrument& instrument_;
  const DeviceSettings device_;
  const HapticOptions options_;
  std::unique_ptr<HapticState> state_ = std::make_unique<HapticState>();
  std::int64_t now_ns_ = first_ns;
  std::uint64_t count_ = 0;
  int capped_ = 0;
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
  Simulation simulation(scene, input, options, result);
  Haptics haptics(scene, options);
  LocalModel local(options.rendering, scene.instrument, haptic_options(scene).contact, simulation.period());
  const auto settle = static_cast<int>(std::lround(input.settle / offline::tick));
  const auto ticks = settle + static_cast<int>(std::lround((input.to - input.from) / offline::tick));
  for (int i = 0; i < ticks; ++i) {
    const double t = input.from + offline::tick * (i - settle);
    const bool swapped = simulation.advance(t);
    const Pose X = offline::instrument_at(input, t).pose;
    if (swapped) local.publish(t, simulation.problem(), simulation.report().contact);
    OfflineTick out;
    {
      const offline::Cost cost(result.haptic, i >= settle);
      out = options.rendering == Rendering::solved ? haptics.step(simulation.problem(), X)
                                                   : tick_of(local.wrench(t, X));
    }
    out.t = t;
    out.swapped = swapped;
    if (i >= settle) result.ticks.push_back(out);
    if (progress && !progress(static_cast<double>(i + 1) / ticks)) break;
  }
  result.capped += haptics.capped();
  return result;
}

}  // namespace hapticd
