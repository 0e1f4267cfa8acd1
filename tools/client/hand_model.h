// A hand holding a device, as one point mass: what `haptic hand` closes the loop with.
//
//   m dv/dt = k (x_t − x) + b_h (v_t − v) − b_d v + F − f_c v/|v|
// with hand stiffness k and damping b_h towards a target (x_t, v_t), the device's own damping b_d,
// Coulomb friction f_c, and the rendered force F on the device.
// Integration is semi-implicit: the damping terms implicitly, then Coulomb friction as an impulse that
// may stop the mass but not reverse it, then x ← x + h v with the new v.
// Units: m, N, kg, s. Target and force are held over one substep.
// Contract: mass > 0, everything else ≥ 0, h well below √(m/k); `check` throws std::invalid_argument.
#pragma once

#include <array>
#include <cstdint>

#include "physics/types.h"

namespace hapticd {

struct HandSettings {
  double mass = 0.1;            // of hand and device as felt at the stylus [kg]
  double stiffness = 300;       // of the grip [N/m]
  double damping = 4;           // of the grip [N·s/m]
  double device_damping = 0.1;  // of the mechanism, against rest [N·s/m]
  double friction = 0;          // Coulomb, of the mechanism [N]
  double quantum = 0;           // of the encoder [m]; 0: continuous
  double delay = 0;             // between a force's arrival and its effect [s]
  double saturation = 0;        // the motors' largest force [N]; 0: unlimited
};

struct HandState {
  Vec3 x = Vec3::Zero();
  Vec3 v = Vec3::Zero();
};

struct HandTarget {
  Vec3 x = Vec3::Zero();
  Vec3 v = Vec3::Zero();
};

void check(const HandSettings& hand);

// One substep of h seconds under the force F.
HandState advanced(const HandSettings& hand, HandState state, const HandTarget& target, const Vec3& force,
                   double h) noexcept;

// The encoder's reading: the nearest multiple of the quantum, in each axis.
Vec3 quantised(const Vec3& x, double quantum) noexcept;

// F, shortened to at most `limit` (0: unlimited).
Vec3 saturated(const Vec3& force, double limit) noexcept;

// Forces on their way to the motors. `at(t)` is the newest force pushed at or before t − delay; before the
// first one, zero. No allocation; holds the last 512 forces, so a delay of up to half a second at 1 kHz.
class ForceDelay {
 public:
  explicit ForceDelay(double delay_s);
  void push(std::int64_t t_ns, const Vec3& force) noexcept;
  Vec3 at(std::int64_t t_ns) noexcept;

 private:
  struct Entry {
    std::int64_t t_ns;
    Vec3 force;
  };
  std::array<Entry, 512> entry_{};
  std::uint64_t first_ = 0, end_ = 0;
  std::int64_t delay_ns_;
  Vec3 present_ = Vec3::Zero();
};

// Passivity observer on the device's port: E = −∫ F·v dt, the energy the server has taken in so far.
// Sign: E ≥ 0 at all times means that the server was passive on this path; −E is energy it made.
struct PassivityObserver {
  double energy = 0;   // [J]
  double minimum = 0;  // [J]
  void add(const Vec3& force, const Vec3& displacement) noexcept {
    energy -= force.dot(displacement);
    if (energy < minimum) minimum = energy;
  }
};

// Scripted press: from a point along a direction to a depth, hold, and back, all with raised-cosine ramps
// (velocity without jumps). Mean speed of a ramp is `speed`; its peak is π/2 times that.
struct Press {
  Vec3 start = Vec3::Zero();
  Vec3 direction = -Vec3::UnitZ();  // unit
  double depth = 0.005;             // [m]
  double speed = 0.01;              // [m/s], > 0
  double hold = 1;                  // [s]

  double duration() const noexcept { return 2 * depth / speed + hold; }
};
HandTarget target_at(const Press& press, double t) noexcept;

}  // namespace hapticd
