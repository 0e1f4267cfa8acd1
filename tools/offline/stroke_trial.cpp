#include "tools/offline/stroke_trial.h"

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>

#include "haptic/haptic_step.h"
#include "physics/tissue/tetrahedron.h"
#include "server/files/paths.h"
#include "server/mesh/mesh_reader.h"
#include "server/scene/scene_reader.h"
#include "server/scene/scene_world.h"

namespace hapticd {

namespace {

constexpr double longest_tick = 1e-3;  // what a device gets; changes of force are per this
constexpr double clearance = 0.2e-3;  // above the surface, where a stroke begins and ends

double between(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * (static_cast<double>(random() >> 11) * 0x1p-53);
}

// The scene's lens alone, under a spherical tip.
Scene lens_scene(const StrokeSettings& s) {
  Scene scene = read_scene(config_directory() / "scenes" / "cataract" / "cataract.yaml");
  scene.bodies.resize(1);
  SceneBody& lens = scene.bodies[0];
  lens.mesh_file.replace_filename(s.mesh + ".msh");
  lens.mesh = read_mesh_file(lens.mesh_file);
  lens.fixed_nodes = lens.mesh.group("zonule")->nodes;
  lens.material.law = s.law;
  scene.contacts.clear();
  scene.instrument.primitives.resize(1);
  scene.instrument.primitives[0] = {};
  scene.instrument.primitives[0].name = "tip";
  scene.instrument.primitives[0].radius = s.tip_radius;
  scene.instrument.tip = 0;
  scene.rate = 1 / s.h;
  scene.compliance = s.compliance;
  scene.sample_spacing = s.tip_radius / 3;
  return scene;
}

// Where the tip is at a time, and whether its pedal is down.
class Strokes {
 public:
  Strokes(const StrokeSettings& s, const TetMesh& mesh) : settings_(s), random_(s.seed) {
    for (const Vec3& x : mesh.nodes) top_ = std::max(top_, x.z());
    period_ = std::ceil(2 * (s.depth + clearance) / s.speed / 0.02 + 2) * 0.02;
  }
  InstrumentSample at(double t) {
    const int stroke = static_cast<int>(std::floor(t / period_ + 1e-9));
    while (static_cast<int>(places_.size()) <= stroke) {
      const double r = settings_.spread * std::sqrt(between(random_, 0, 1));
      const double a = between(random_, 0, 2 * std::numbers::pi);
      places_.emplace_back(r * std::cos(a), r * std::sin(a));
    }
    const double since = t - stroke * period_;
    const double down = settings_.speed * since, deepest = settings_.depth + clearance;
    const double below = std::max(0.0, down < deepest ? down : 2 * deepest - down);
    InstrumentSample sample;
    sample.present = true;
    sample.pose.p = {places_[stroke].x(), places_[stroke].y(),
                     top_ + settings_.tip_radius + clearance - below};
    sample.phaco = sample.aspiration = settings_.removal && stroke % 2 == 1 && below > clearance;
    clear_ = below < 0.25 * clearance;
    return sample;
  }
  bool clear() const { return clear_; }  // at the last time asked for
  int steps_per_stroke() const { return static_cast<int>(std::lround(period_ / settings_.h)); }

 private:
  StrokeSettings settings_;
  std::mt19937_64 random_;
  std::vector<Eigen::Vector2d> places_;
  double top_ = -1, period_ = 0;
  bool clear_ = true;
};

// The scene's pose as the device's, so that haptic_step's map takes it back.
Pose on_device(const DeviceSettings& d, const Pose& X) {
  return {d.frame.conjugate() * ((X.p - d.origin) / d.position_scale),
          (d.frame.conjugate() * X.q * d.tool.conjugate()).normalized()};
}

void look_at_volumes(const World& world, StrokeReport& report) {
  const Body& body = world.bodies()[0];
  int inverted = 0;
  for (int t = 0; t < body.model.tet_count(); ++t) {
    if (!body.state.alive[t]) continue;
    const double J =
        deformation_gradient(corners_of(body.model.mesh.tets[t], body.state.x), body.model.gradients[t])
            .determinant();
    if (!std::isfinite(J)) ++report.not_finite;
    report.least_volume = std::min(report.least_volume, J);
    inverted += J <= 0;
  }
  report.inverted_steps += inverted > 0;
  report.most_inverted = std::max(report.most_inverted, inverted);
}

class Trial {
 public:
  Trial(const StrokeSettings& s, const Scene& scene, Strokes& strokes, StrokeReport& report)
      : settings_(s), scene_(scene), strokes_(strokes), report_(report), world_(make_world(scene)) {
    // So wide that no motion of these is refused; its limits act on what is sent, not on what is reported.
    scene_.device.max_speed = 1e3;
    scene_.device.workspace_radius = 1;
    options_ = haptic_options(scene);
  }

  // From `begin` on, the next simulation step and its ticks; what was published before is felt until h/2.
  void step(double begin) {
    const double tick = std::min(longest_tick, settings_.h / 2);  // so that h/2 falls on one
    const int ticks = static_cast<int>(std::lround(settings_.h / tick)), half = ticks / 2;
    int asked = 0;
    const auto started = std::chrono::steady_clock::now();
    const StepReport r =
        world_->step([&] { return strokes_.at(begin + (asked++ > 0 ? settings_.h / 4 : 0)); }, *next_);
    for (ReferenceJob& job : world_->wanted_references()) {
      job.reference->make();
      world_->adopt(std::move(job));
    }
    spent_ += std::chrono::steady_clock::now() - started;
    report_.removed += r.removed;
    ++report_.steps;
    look_at_volumes(*world_, report_);
    for (int k = 0; k < ticks; ++k) {
      if (k == half) {
        std::swap(problem_, next_);
        fresh_ = true;
      }
      feel(begin + k * tick, tick);
    }
  }
  double spent_ms() const { return std::chrono::duration<double, std::milli>(spent_).count(); }

  bool keep_force = false;

 private:
  void feel(double t, double tick) {
    const std::int64_t now = 1'000'000'000 + std::llround(1e9 * t);
    const InstrumentSample at = strokes_.at(t);
    HapticInput input;
    input.now_ns = now;
    input.period_ns = std::llround(1e9 * tick);
    input.presence.connected = true;
    input.presence.new_client = sequence_ == 0;
    input.taken = true;
    input.sample.sequence = ++sequence_;
    input.sample.received_ns = now;
    input.sample.pose = on_device(scene_.device, at.pose);
    input.sample.enable = true;
    if (fresh_) problem_->published_ns = now;
    const ForceSample answer = haptic_step(problem_->step > 0 ? problem_.get() : nullptr,
                                           world_->instrument(), scene_.device, options_, input, *haptic_);
    report_.solver_caps = std::max(report_.solver_caps, static_cast<int>(answer.solver_caps));
    if (answer.status & (status_not_finite | status_latched)) ++report_.refused;
    const Vec3 force = haptic_->rendered.force / scene_.device.force_scale;
    if (!force.allFinite() || !answer.force.allFinite()) ++report_.not_finite;
    const double since = t / longest_tick;
    if (std::abs(since - std::round(since)) > 1e-6) return;
    const double change = (force - last_).norm();
    if (problem_->step > 0 && seen_) {
      report_.peak = std::max(report_.peak, force.norm());
      report_.largest_change = std::max(report_.largest_change, change);
      if (!fresh_) report_.largest_change_in_step = std::max(report_.largest_change_in_step, change);
      if (force.norm() > 0) changes.push_back(change);
      if (strokes_.clear()) report_.left_after = std::max(report_.left_after, force.norm());
    }
    if (keep_force) report_.force.push_back(force.norm());
    seen_ = seen_ || haptic_->solved;
    last_ = force;
    fresh_ = false;
  }

 public:
  std::vector<double> changes;

 private:
  StrokeSettings settings_;
  Scene scene_;
  Strokes& strokes_;
  StrokeReport& report_;
  HapticOptions options_;
  std::unique_ptr<World> world_;
  std::unique_ptr<CondensedProblem> problem_ = std::make_unique<CondensedProblem>();
  std::unique_ptr<CondensedProblem> next_ = std::make_unique<CondensedProblem>();
  std::unique_ptr<HapticState> haptic_ = std::make_unique<HapticState>();
  std::chrono::steady_clock::duration spent_{};
  std::uint64_t sequence_ = 0;
  Vec3 last_ = Vec3::Zero();
  bool fresh_ = false, seen_ = false;
};

}  // namespace

StrokeReport run_strokes(const StrokeSettings& settings, bool keep_force,
                         const std::function<bool(double)>& progress) {
  StrokeReport report;
  const Scene scene = lens_scene(settings);
  Strokes strokes(settings, scene.bodies[0].mesh);
  std::vector<double> changes;
  double spent = 0;
  // A fresh lens is never put around a tip: episodes are of whole strokes.
  const int per_stroke = strokes.steps_per_stroke();
  const int episode = std::max(1, settings.episode / per_stroke) * per_stroke;
  for (int done = 0; done < settings.steps; done += episode) {
    Trial trial(settings, scene, strokes, report);
    trial.keep_force = keep_force;
    const int steps = std::min(episode, settings.steps - done);
    for (int k = 0; k < steps; ++k) {
      trial.step((done + k) * settings.h);
      if (k % 25 == 0 && !progress(static_cast<double>(done + k) / settings.steps)) return report;
    }
    changes.insert(changes.end(), trial.changes.begin(), trial.changes.end());
    spent += trial.spent_ms();
  }
  if (!changes.empty()) {
    const auto at =
        changes.begin() + static_cast<std::ptrdiff_t>(0.999 * static_cast<double>(changes.size() - 1));
    std::nth_element(changes.begin(), at, changes.end());
    report.change_p999 = *at;
  }
  report.steps_ms = spent / report.steps;
  return report;
}

}  // namespace hapticd
