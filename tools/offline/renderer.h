// What renders a force for whoever holds the device (closed_loop.h): the daemon in virtual time
// (server/schedule/virtual_daemon.h), the baselines beside it, and a wall that is a spring.
//
//   tick i at t = i · 1 ms, with the state that arrived, if one did
//
// Nothing depends on the clock: two runs agree bit for bit. Units: SI, ns in samples. Errors: as World's.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "server/schedule/late_steps.h"
#include "server/schedule/virtual_daemon.h"
#include "tools/offline/baseline_rendering.h"

namespace hapticd {

struct DaemonRendererOptions {
  // Others than `solved` are baselines: the force of baseline_rendering.h, cut off at the device's largest,
  // with none of the daemon's watchdogs, blends and slew limits.
  Rendering rendering = Rendering::solved;
  bool passivity_control = false;
  bool watchdogs = true;                 // false: a state or a problem counts for as long as none follows
  double publish_after = 10e-3;          // of a step's begin, at most a period [s]
  double stall_from = 0, stall_for = 0;  // [s]
  int reference_steps = 1;  // from the step that asks for a reference factor to the one that adopts it
  std::optional<LinkTrouble> link;   // between the daemon's halves
  double problem_old = 0;            // let_problems_grow_old; 0: as usual [s]
  std::optional<double> blend_time;  // after a removal [s]; absent: the daemon's
  std::function<void()> begun;       // called when a step has begun, after its removals and cuts …
  std::function<void()> published;   // … and when its problem is out
  std::optional<LateSteps> late;     // in place of publish_after
  int sweeps_only = 0;               // > 0: contact by so many sweeps of block Gauss-Seidel, in both loops
};

// What renders a force from a device's state, each millisecond.
class Renderer {
 public:
  virtual ~Renderer() = default;
  // The state that arrived since the last tick, or null.
  virtual ForceSample tick(const DeviceSample* arrived) = 0;
};

class DaemonRenderer final : public Renderer {
 public:
  DaemonRenderer(const Scene& scene, const DaemonRendererOptions& options);

  ForceSample tick(const DeviceSample* arrived) override;

  const World& world() const { return daemon_.world(); }
  const HapticState& haptic() const { return daemon_.haptic().state(); }

 private:
  VirtualDaemonSettings settings();
  ForceSample baseline(std::int64_t now_ns);

  DaemonRendererOptions options_;
  VirtualTiming timing_;
  VirtualDaemon daemon_;
  LocalModel local_;
  DeviceSample newest_;
  std::int64_t count_ = 0;
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
