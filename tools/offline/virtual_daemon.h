// The daemon in virtual time: its simulation step and its haptic tick in one thread, for whoever holds the
// device (closed_loop.h).
//
//   tick i at t = i · 1 ms   haptic_step on the newest problem in use, with the state that arrived, if one
//   did step k                   begins at k h with the instrument as the loop told it last, latches it
//                            `latch_after` later, and its problem is in use from `publish_after` on; where
//                            something goes, an interim problem (interim.h) from the tick after the latch on,
//                            and its own made again (World::refresh) with the poses of k h + refresh_at h
//
// As offline_run.h, but closed: a step is computed when its problem is due, so that poses up to its latch are
// known, whatever they depend on. A stall is a time in which no step begins. Bases are adopted
// `reference_steps` steps after. Nothing depends on the clock: two runs agree bit for bit. Units: SI, ns in
// samples. Errors: as World's.
#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <vector>

#include "haptic/haptic_step.h"
#include "physics/simulation/world.h"
#include "server/scene/scene.h"
#include "tools/offline/baseline_rendering.h"

namespace hapticd {

struct VirtualDaemonOptions {
  // Others than `solved` are baselines: the force of baseline_rendering.h, cut off at the device's largest,
  // with none of the daemon's watchdogs, blends and slew limits.
  Rendering rendering = Rendering::solved;
  bool passivity_control = false;
  bool watchdogs = true;                 // false: a state or a problem counts for as long as none follows
  double latch_after = 1e-3;             // of a step's begin [s]
  double publish_after = 10e-3;          // … at most a period [s]
  double stall_from = 0, stall_for = 0;  // [s]
  int reference_steps = 1;               // from the step that asks for a base to the one that adopts it
  // Poses of World::refresh, in periods after a step's begin; in use 2 ms later, where that is between the
  // step's own problem and the next step. The daemon's are 0.6 and 0.8.
  std::vector<double> refresh_at;
  std::optional<double> blend_time;  // after a removal [s]; absent: the daemon's
  int sweeps_only = 0;               // > 0: contact by so many sweeps of block Gauss-Seidel, in both loops
};

// What renders a force from a device's state, each millisecond.
class Renderer {
 public:
  virtual ~Renderer() = default;
  // The state that arrived since the last tick, or null.
  virtual ForceSample tick(const DeviceSample* arrived) = 0;
};

class VirtualDaemon final : public Renderer {
 public:
  VirtualDaemon(const Scene& scene, const VirtualDaemonOptions& options);

  ForceSample tick(const DeviceSample* arrived) override;

  const World& world() const { return *world_; }
  const HapticState& haptic() const { return *state_; }

 private:
  struct Known {
    double t;
    InstrumentSample sample;
  };

  void advance(double t);
  void step(double begin);
  void refresh(double use);
  InstrumentSample known_at(double t) const;
  ForceSample baseline(const DeviceSample& sample, double t);

  DeviceSettings device_;
  Instrument instrument_;
  HapticOptions haptic_;
  VirtualDaemonOptions options_;
  double h_;
  std::unique_ptr<World> world_;
  std::unique_ptr<CondensedProblem> in_use_ = std::make_unique<CondensedProblem>(),
                                    next_ = std::make_unique<CondensedProblem>();
  bool stepped_ = false;     // the step that begins at `begin_` was made, and its problem is `next_`
  ContactSolution contact_;  // of that step
  std::unique_ptr<HapticState> state_ = std::make_unique<HapticState>();
  LocalModel local_;
  std::deque<Known> known_;
  struct Base {
    std::int64_t step;  // that adopts it
    ReferenceJob job;
  };
  std::deque<Base> bases_;
  std::deque<double> refreshes_;  // when problems made again come into use [s]
  DeviceSample newest_;
  double begin_ = 0;
  std::int64_t count_ = 0, steps_ = 0;
};

// The largest stiffness that a haptic loop can show: a wall that is a spring and a damper, no simulation.
//
//   F = max(0, K d + K τ ḋ) n    d: depth below the plane through `point`; ḋ: from the last two states
class SpringWall final : public Renderer {
 public:
  SpringWall(const Vec3& point, const Vec3& normal, double stiffness, double damping_time)
      : point_(point), normal_(normal), stiffness_(stiffness), damping_time_(damping_time) {}

  ForceSample tick(const DeviceSample* arrived) override;

 private:
  Vec3 point_, normal_;
  double stiffness_, damping_time_;
  double depth_ = 0;
  bool has_depth_ = false;
  ForceSample last_;
};

}  // namespace hapticd
