// Two devices of one world: two balls on one soft sheet, each force depending on both poses.
//
// Each device's hand is 5 mm high over its place and goes down to `depth` below the sheet. Forces are some
// millinewtons, slew limits a fifth of one in a tick: what one hand does to the other is limited.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "haptic/haptic_step.h"
#include "tests/support/contact_problems.h"

namespace hapticd::two_devices {

inline constexpr std::int64_t ms = 1'000'000;
inline constexpr double radius = 1e-3, apart = 2.6e-3;  // [m]

struct Hands {
  static constexpr int count = 2;

  std::unique_ptr<CondensedProblem> problem;
  std::vector<Instrument> instruments{sphere_instrument(radius), sphere_instrument(radius)};
  std::vector<DeviceSettings> devices = std::vector<DeviceSettings>(count);
  HapticOptions options;
  std::unique_ptr<HapticState> state = std::make_unique<HapticState>();
  HapticInput in;
  EachInstrument<double> depth;  // of each ball in the sheet [m]
  EachInstrument<ForceSample> force, before;
  bool publish = true;  // the simulation lives

  explicit Hands(double friction = 0.2) {
    Random random(5);
    SheetSettings sheet;
    sheet.friction = friction;
    problem = sheet_problem(random, sheet);
    problem->step = 1;
    options.contact.margin = 1e-3;
    in.now_ns = 1000 * ms;
    for (int i = 0; i < count; ++i) {
      problem->instrument[i].coupling = {.stiffness = 200, .rotational_stiffness = 0.1, .damping_time = 2e-3};
      problem->instrument[i].X_ref.p = place(i);
      DeviceSettings& d = device(i);
      d.id = static_cast<std::uint32_t>(i);
      d.max_force = 0.02;
      d.max_force_rate = 0.2;
      d.max_speed = 2;
      d.damping = 0.05;
      depth[i] = -1e-3;
      in.device[i].presence.connected = true;
      in.device[i].sample.enable = true;
    }
  }

  DeviceSettings& device(int i) { return devices[static_cast<std::size_t>(i)]; }
  Vec3 place(int i) const { return Vec3((i - 0.5) * apart, 0, radius - depth[i]); }
  double step(int i) { return 1e-3 * device(i).max_force_rate; }
  bool present(int i) const { return state->X.present[i]; }
  bool armed(int i) const { return (force[i].status & status_disarmed) == 0; }

  // One tick later; `bend` edits what came.
  void tick(const std::function<void(HapticInput&)>& bend = {}, std::int64_t after = ms) {
    in.now_ns += after;
    if (publish) problem->published_ns = in.now_ns;
    for (int i = 0; i < count; ++i) {
      DeviceInput& d = in.device[i];
      ++d.sample.sequence;
      d.sample.received_ns = in.now_ns;
      d.sample.pose.p = place(i);
    }
    HapticInput now = in;
    for (int i = 0; i < count; ++i) {
      now.device[i].presence.new_client = in.device[i].sample.sequence == 1;
      now.device[i].taken = true;
    }
    if (bend) bend(now);
    before = force;
    force = haptic_step(problem.get(), Instruments(instruments), devices, options, now, *state);
  }
  // Both armed, and the balls as deep as these in 200 ms.
  void press(double first, double second) {
    const EachInstrument<double> from = depth;
    for (int i = 1; i <= 400; ++i) {
      depth[0] = from[0] + (first - from[0]) * std::min(1.0, i / 200.0);
      depth[1] = from[1] + (second - from[1]) * std::min(1.0, i / 200.0);
      tick();
    }
  }
};

}  // namespace hapticd::two_devices
