// What crosses between a device and the haptic loop, as plain values.
//
//   p_scene = origin + q_frame (position_scale · p_device),   q_scene = q_frame q_device q_tool
//   f_device = force_scale · q_frameᵀ f_scene,   τ_device = (force_scale / position_scale) · q_frameᵀ τ_scene
// and, with a pivot, the shaft turned about its tip so that it passes through that point (pivot.h).
//
// Both parts of the wrench then do work in the same ratio, force_scale / position_scale.
// Units: m, N, N·m, ns (CLOCK_MONOTONIC of the daemon unless said otherwise). The device frame is the
// device's own workspace; `to_scene` maps it into the scene.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "haptic/pivot.h"
#include "physics/types.h"

namespace hapticd {

enum Button : std::uint32_t { pedal_phaco = 1u << 0, pedal_aspiration = 1u << 1 };

struct DeviceSample {
  std::uint64_t sequence = 0;       // the client's, strictly rising
  std::int64_t client_time_ns = 0;  // the client's clock, echoed
  std::int64_t received_ns = 0;     // daemon's clock, between the previous take and this one
  Pose pose;                        // device frame; any bits until check_sample accepts it
  std::uint32_t buttons = 0;
  bool enable = false;  // the client asks for force
};

// Who is at the other end of the device topic, as seen at one take.
struct Presence {
  bool connected = false;   // a client holds the device; false: gone, zero at once
  bool new_client = false;  // the sample just taken is the first of a new client
  bool conflict = false;    // another client's sample was refused at this take
  bool rival = false;       // another writer of this device's forces is heard
  bool settled = true;      // the port has listened for other writers long enough; false: do not arm
};

// Where the instrument is and what the pedals ask, from the haptic loop to the simulation.
struct InstrumentInput {
  bool present = false;       // a valid device state younger than 10 ms exists
  Pose X;                     // scene; the newest valid one, also when not present
  std::uint32_t buttons = 0;  // 0 when not present
  std::int64_t received_ns = 0;
  std::uint64_t sequence = 0;  // of the device state
  double vacuum = 0;           // of the instrument's pump [Pa]
};

// Bits of a force message; 0 is: armed, all well.
enum Status : std::uint32_t {
  status_disarmed = 1u << 0,      // no force is being rendered
  status_holding = 1u << 1,       // no device state for 3 ms: last force held
  status_ramping_down = 1u << 2,  // no device state for 10 ms; or on the way to zero within the slew limit
  status_ramping_up = 1u << 3,    // after arming
  status_problem_old = 1u << 4,   // condensed problem older than 60 ms: damping only
  status_problem_lost = 1u << 5,  // older than 200 ms: zero
  status_gap = 1u << 6,           // the loop itself slept ≥ 5 ms
  status_rejected = 1u << 7,      // the newest state was refused
  status_latched = 1u << 8,       // three refusals in a row: zero until re-armed
  status_conflict = 1u << 9,      // a second writer for this device was seen
  status_saturated = 1u << 10,    // the device's maximum force was reached
  status_slew_limited = 1u << 11,
  status_not_finite = 1u << 12,        // a force was not finite: zero, latched
  status_solver_cap = 1u << 13,        // the contact solve ended at its cap or deadline
  status_blending = 1u << 14,          // ≤ 5 ms after a removal or a stall
  status_contacts_dropped = 1u << 15,  // more contacts than capacity
  status_contact_lost = 1u << 17,  // tissue was or is in the instrument, or past it, and no contact held it
  status_rival = 1u << 16          // somebody else writes this device's forces: to zero, latched
};

struct ForceSample {
  std::uint64_t sequence = 0;       // the loop's tick
  std::uint64_t echo_sequence = 0;  // of the newest valid device state; 0: none
  bool answers = false;             // that state came with this tick
  std::int64_t echo_client_time_ns = 0;
  Vec3 force = Vec3::Zero();   // device frame, on the device [N]
  Vec3 torque = Vec3::Zero();  // [N·m]
  std::uint32_t status = status_disarmed;
  std::uint64_t step = 0;         // simulation step of the condensed problem
  std::int64_t state_age_ns = 0;  // tick − receipt of the state, never negative
  std::int64_t problem_age_ns = 0;
  std::int64_t wake_ns = 0;  // lateness of this tick against the intended time
  std::int64_t solve_ns = 0;
  std::uint32_t contacts = 0;
  std::uint32_t active = 0;
  std::uint32_t dropped = 0;
  std::uint32_t samples = 0;          // of the problem: surface within reach,
  std::uint32_t samples_dropped = 0;  // … and what of that did not fit: the farthest
  std::uint32_t solver_caps = 0;      // contact solves so far that ended at their cap or deadline
  double residual = 0;
  double penetration = 0;  // scene, of the last solve that was rendered [m]
  double energy = 0;       // passivity observer: what the client put in less what it got [J]
};

// A spring between a hand and another one of its scene (limits.h). Off where there is none.
struct Ghost {
  int of = 0;            // the other instrument
  double stiffness = 0;  // as the hand feels it [N/m]
  double max_force = 0;  // [N]
};

// A device's limits and its map into the scene (config/devices/*.yaml).
struct DeviceSettings {
  std::uint32_t id = 0;
  double max_force = 0;           // [N]; 0: no force at all
  double max_torque = 0;          // [N·m]; 0: a 3-DoF device, torque is not sent
  double max_force_rate = 0;      // slew limit [N/s]; 0: no force at all
  double max_speed = 0;           // a faster jump between states is refused [m/s]
  double workspace_radius = 0;    // [m]
  double damping = 0;             // for "damping only" [N·s/m]
  double quantum = 0;             // of its encoders, at the stylus [m]; 0: not known
  double position_scale = 1;      // scene metres per device metre
  double force_scale = 1;         // device newtons per scene newton
  Vec3 origin = Vec3::Zero();     // scene point of the device's origin [m]
  Quat frame = Quat::Identity();  // device axes → scene axes
  Quat tool = Quat::Identity();   // instrument axes in the stylus frame
  std::optional<Pivot> pivot;     // through which the shaft passes, whatever the stylus says
  std::optional<Ghost> ghost;
};

// Device pose to instrument pose in the scene, and a scene wrench (about the tip) back to the device.
inline Pose stylus_in_scene(const DeviceSettings& d, const Pose& device) noexcept {
  return {d.origin + d.frame * (d.position_scale * device.p), (d.frame * device.q * d.tool).normalized()};
}
inline Pose to_scene(const DeviceSettings& d, const Pose& device) noexcept {
  const Pose stylus = stylus_in_scene(d, device);
  return d.pivot ? through_pivot(*d.pivot, stylus) : stylus;
}
struct Wrench {
  Vec3 force = Vec3::Zero();   // [N]
  Vec3 torque = Vec3::Zero();  // [N·m]
};
inline Wrench wrench_on_device(const DeviceSettings& d, const Pose& device, const Vec6& scene) noexcept {
  const Vec6 on = d.pivot ? on_stylus(*d.pivot, stylus_in_scene(d, device), scene) : scene;
  return {d.force_scale * (d.frame.conjugate() * on.head<3>()),
          d.force_scale / d.position_scale * (d.frame.conjugate() * on.tail<3>())};
}

}  // namespace hapticd
