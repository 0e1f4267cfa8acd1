#include "tools/offline/stroke_trial.h"

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>
#include <random>

#include "physics/tissue/tetrahedron.h"
#include "server/files/paths.h"
#include "server/mesh/mesh_reader.h"
#include "server/scene/scene_reader.h"
#include "server/scene/scene_world.h"
#include "server/schedule/virtual_daemon.h"

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
  Instrument& ball = scene.first().shape;
  ball.primitives.resize(1);
  ball.primitives[0] = {};
  ball.primitives[0].name = "tip";
  ball.primitives[0].radius = s.tip_radius;
  ball.tip = 0;
  scene.first().device.pivot.reset();  // there is no cornea
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

// As for 20 ms, or as many parts of a shorter step.
VirtualTiming timing_for(double h, const World& world) {
  constexpr double usual_step = 20e-3;
  VirtualTiming timing = usual_timing(world);
  const double part = std::min(1.0, h / usual_step);
  for (std::int64_t* t : {&timing.interim, &timing.latch, &timing.removal_latch, &timing.publish,
                          &timing.refresh, &timing.reference})
    *t = std::llround(part * static_cast<double>(*t));
  return timing;
}

class Trial {
 public:
  Trial(const StrokeSettings& s, const Scene& scene, Strokes& strokes, StrokeReport& report, double begin)
      : scene_(scene), strokes_(strokes), report_(report), begin_(begin) {
    tick_ = std::min(longest_tick, s.h / 2);
    // So wide that no motion of these is refused; its limits act on what is sent, not on what is reported.
    scene_.first().device.max_speed = 1e3;
    scene_.first().device.workspace_radius = 1;
    auto world = make_world(scene);
    VirtualDaemonSettings settings;
    settings.timing = timing_for(s.h, *world);
    settings.first_ns = first_ns;
    settings.before = [this](StepAction, std::int64_t) { started_ = std::chrono::steady_clock::now(); };
    settings.after = [this](StepAction action, std::int64_t) { after(action); };
    daemon_.emplace(std::move(world), scene.rate, scene_.first().device, haptic_options(scene), settings);
  }

  // The ticks of the k-th step's time.
  void step(int k) {
    const int ticks = static_cast<int>(std::lround(1 / (scene_.rate * tick_)));
    for (int i = 0; i < ticks; ++i) feel(static_cast<double>(k * ticks + i) * tick_);
  }
  double spent_ms() const { return std::chrono::duration<double, std::milli>(spent_).count(); }

  bool keep_force = false;
  std::vector<double> changes;

 private:
  static constexpr std::int64_t first_ns = 1'000'000'000;

  void after(StepAction action) {
    spent_ += std::chrono::steady_clock::now() - started_;
    if (action == StepAction::finish) {
      report_.removed += daemon_->schedule().report().removed;
      ++report_.steps;
      look_at_volumes(daemon_->world(), report_);
    }
    fresh_ = fresh_ || action == StepAction::publish || action == StepAction::publish_interim ||
             action == StepAction::publish_refresh;
  }

  // since: the episode's begin [s].
  void feel(double since) {
    const double t = begin_ + since;
    const InstrumentSample at = strokes_.at(t);
    HapticInput input;
    input.now_ns = first_ns + std::llround(1e9 * since);
    input.period_ns = std::llround(1e9 * tick_);
    input.device[0].presence.connected = true;
    input.device[0].presence.new_client = sequence_ == 0;
    input.device[0].taken = true;
    input.device[0].sample.sequence = ++sequence_;
    input.device[0].sample.received_ns = input.now_ns;
    input.device[0].sample.pose = to_device(scene_.first().device, at.pose);
    input.device[0].sample.buttons = (at.phaco ? pedal_phaco : 0u) | (at.aspiration ? pedal_aspiration : 0u);
    input.device[0].sample.enable = true;
    const ForceSample answer = daemon_->tick(input)[0];
    const HapticState& haptic = daemon_->haptic().state();
    report_.solver_caps = std::max(report_.solver_caps, static_cast<int>(answer.solver_caps));
    if (answer.status & (status_not_finite | status_latched)) ++report_.refused;
    const Vec3 force = haptic.device[0].rendered.force / scene_.first().device.force_scale;
    if (!force.allFinite() || !answer.force.allFinite()) ++report_.not_finite;
    const double in_ms = t / longest_tick;
    if (std::abs(in_ms - std::round(in_ms)) > 1e-6) return;
    const double change = (force - last_).norm();
    if (answer.step > 0 && seen_) {
      report_.peak = std::max(report_.peak, force.norm());
      report_.largest_change = std::max(report_.largest_change, change);
      if (!fresh_) report_.largest_change_in_step = std::max(report_.largest_change_in_step, change);
      if (force.norm() > 0) changes.push_back(change);
      if (strokes_.clear()) report_.left_after = std::max(report_.left_after, force.norm());
    }
    if (keep_force) report_.force.push_back(force.norm());
    seen_ = seen_ || haptic.solved;
    last_ = force;
    fresh_ = false;
  }

  Scene scene_;
  Strokes& strokes_;
  StrokeReport& report_;
  const double begin_;
  double tick_ = longest_tick;
  std::optional<VirtualDaemon> daemon_;
  std::chrono::steady_clock::time_point started_{};
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
    Trial trial(settings, scene, strokes, report, done * settings.h);
    trial.keep_force = keep_force;
    const int steps = std::min(episode, settings.steps - done);
    for (int k = 0; k < steps; ++k) {
      trial.step(k);
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
