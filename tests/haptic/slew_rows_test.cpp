// The safety table's last row: whatever happens, in any order, a force changes by max_force_rate · 1 ms per
// tick at most, but where the client is gone, asks for no force, or a number is not finite. There it is
// exactly zero.
#include <functional>
#include <random>

#include <gtest/gtest.h>

#include "haptic/haptic_step.h"
#include "tests/haptic/wall.h"
#include "tests/support/one_device.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

struct Limits {
  const char* name;
  double force, torque, rate, damping;
};
void PrintTo(const Limits& l, std::ostream* out) { *out << l.name; }

// A device over the wall, whose hand moves at up to half a metre a second.
struct SlewRows : testing::TestWithParam<Limits> {
  DeviceSettings device;
  const Instrument instrument = wall::instrument();
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();
  HapticOptions options;
  std::unique_ptr<HapticState> state = std::make_unique<HapticState>();
  HapticInput in;
  // Pressed by 0.7 of the tip's radius it is at its limit.
  const double force_scale = 13 * GetParam().force;
  double height = wall::radius;  // of the tip's centre in the scene
  bool publish = true;           // the simulation lives
  ForceSample before;

  SlewRows() {
    device.max_force = GetParam().force;
    device.max_torque = GetParam().torque;
    device.max_force_rate = GetParam().rate;
    device.max_speed = 2;
    device.damping = GetParam().damping;
    device.position_scale = 0.1;
    device.force_scale = force_scale;
    in.now_ns = 1000 * ms;
    in.device[0].presence.connected = true;
    in.device[0].sample.enable = true;
    wall::make(*problem, 1, in.now_ns);
  }

  // One tick later, with a good state unless `bend` says otherwise.
  ForceSample tick(const std::function<void(HapticInput&)>& bend = {}, std::int64_t after = ms) {
    in.now_ns += after;
    if (publish) problem->published_ns = in.now_ns;
    ++in.device[0].sample.sequence;
    in.device[0].sample.received_ns = in.now_ns;
    in.device[0].sample.pose.p.z() = height / device.position_scale;
    HapticInput now = in;
    now.device[0].presence.new_client = in.device[0].sample.sequence == 1;
    now.device[0].taken = true;
    if (bend) bend(now);
    const ForceSample f = haptic_step(problem.get(), instrument, device, options, now, *state);
    check(f, now);
    before = f;
    return f;
  }
  void check(const ForceSample& f, const HapticInput& now) const {
    constexpr double rounding = 1 + 1e-12;
    const bool zero = f.force.isZero(0) && f.torque.isZero(0);
    const bool exempt =
        !now.device[0].presence.connected || !state->device[0].watchdog.sample.enable || (f.status & status_not_finite);
    if (exempt) {
      ASSERT_TRUE(zero);
    } else {
      ASSERT_LE((f.force - before.force).norm(), rounding * 1e-3 * device.max_force_rate + 1e-15) << f.status;
      ASSERT_LE((f.torque - before.torque).norm(),
                rounding * 1e-3 * device.max_force_rate * device.max_torque / device.max_force + 1e-15)
          << f.status;
    }
    ASSERT_LE(f.force.norm(), rounding * device.max_force);
    if (f.status & status_disarmed) {
      ASSERT_TRUE(zero) << f.status;
    }
  }
  void move(double speed) { height += 1e-3 * speed * device.position_scale; }
  // Armed, pressed on the wall, and then moving up at half a metre a second, which damping alone resists.
  void damped() {
    for (int i = 0; i < 120; ++i) tick();
    while (height > 0.3 * wall::radius) {
      move(-0.46);
      tick();
    }
    publish = false;
    for (int i = 0; i < 150; ++i) {
      if (i > 70) move(0.46);
      tick();
    }
    ASSERT_TRUE(before.status & status_problem_old);
    ASSERT_NEAR(before.force.norm(), std::min(device.max_force, 0.46 * device.damping), 1e-3);
  }
};

// The simulation held for 500 ms under a hand that moves at 0.46 m/s: 1.84 N of a Touch, 12 of an
// omega.6.
TEST_P(SlewRows, ALostProblemIsReleasedWithinTheSlewLimit) {
  damped();
  const double felt = before.force.norm();
  int releasing = 0;
  ForceSample f = before;
  for (int i = 0; i < 350; ++i) {
    move(0.46);
    f = tick();
    if (!(f.status & status_problem_lost) || f.force.isZero(0)) continue;
    ++releasing;
    EXPECT_TRUE(f.status & status_ramping_down);
    EXPECT_FALSE(f.status & status_disarmed);
  }
  EXPECT_EQ(f.status, status_problem_lost);
  EXPECT_EQ(f.force, Vec3::Zero());
  // Whole steps, the last to zero; rounding may leave a tick more.
  const double ticks = felt / (1e-3 * device.max_force_rate);
  EXPECT_GE(releasing, static_cast<int>(std::ceil(ticks - 1e-6)) - 1);
  EXPECT_LE(releasing, static_cast<int>(std::ceil(ticks + 1e-6)));
  // It comes back as it does after arming.
  publish = true;
  f = tick();
  EXPECT_TRUE(f.status & status_ramping_up);
}

TEST_P(SlewRows, AStallOfTheLoopAndThreeRefusalsReleaseToo) {
  damped();
  ForceSample f = tick({}, 120 * ms);
  EXPECT_TRUE(f.status & status_gap);
  EXPECT_GT(f.force.norm(), 0);
  for (int i = 0; i < 30; ++i) f = tick();
  EXPECT_EQ(f.force, Vec3::Zero());
  EXPECT_TRUE(f.status & status_disarmed);

  publish = true;
  tick([](HapticInput& now) { now.device[0].sample.enable = false; });
  height = wall::radius;
  state->device[0].watchdog.has_sample = false;  // put down elsewhere
  for (int i = 0; i < 130; ++i) tick();
  damped();
  for (int i = 0; i < 3; ++i) f = tick([](HapticInput& now) { now.device[0].sample.pose.p.x() = std::nan(""); });
  EXPECT_TRUE(f.status & status_latched);
  EXPECT_GT(f.force.norm(), 0);
  for (int i = 0; i < 30; ++i) f = tick();
  EXPECT_EQ(f.force, Vec3::Zero());
  EXPECT_EQ(f.status & (status_latched | status_disarmed), status_latched | status_disarmed);
}

TEST_P(SlewRows, ClientGoneAndEnableFalseAreZeroInTheSameTick) {
  damped();
  EXPECT_EQ(tick([](HapticInput& now) { now.device[0].sample.enable = false; }).force, Vec3::Zero());
}

// Every row, drawn at random, thousands of times on top of one another.
TEST_P(SlewRows, AnyOrderOfEventsKeepsTheLimit) {
  std::mt19937 random(7);
  const auto below = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
  std::uint32_t seen = 0;
  double peak = 0;
  int released = 0;
  double speed = 0;
  std::uint64_t step = 1;
  for (int tick_number = 0; tick_number < 60'000; ++tick_number) {
    if (below(60) == 0) speed = 0.5 * (2.0 * below(1000) / 999 - 1);
    if ((height > 2 * wall::radius && speed > 0) || (height < 0.3 * wall::radius && speed < 0)) speed = -speed;
    move(speed);
    if (below(20) == 0) wall::make(*problem, ++step, problem->published_ns, below(3) == 0 ? -1e-3 : 0);
    problem->topology_changed = below(8) == 0;
    std::int64_t after = ms;
    std::function<void(HapticInput&)> bend;
    switch (below(400)) {
      case 0:
        publish = !publish;
        break;
      case 1:
        after = (2 + below(150)) * ms;
        break;
      case 2:
        bend = [](HapticInput& now) { now.device[0].presence.connected = false; };
        break;
      case 3:
        bend = [](HapticInput& now) { now.device[0].sample.enable = false; };
        break;
      case 4:
        bend = [](HapticInput& now) { now.device[0].presence.conflict = true; };
        break;
      case 5:
        device.force_scale = std::numeric_limits<double>::infinity();
        break;
      case 6: {  // silence
        for (int n = below(130); n > 0; --n) {
          tick([](HapticInput& now) { now.device[0].taken = false; });
          seen |= before.status;
        }
        break;
      }
      case 7: {  // refusals
        for (int n = below(6); n > 0; --n) {
          tick([](HapticInput& now) { now.device[0].sample.pose.p.x() = std::nan(""); });
          seen |= before.status;
        }
        break;
      }
      case 8:
        bend = [](HapticInput& now) { now.device[0].presence.new_client = true; };
        break;
      default:
        break;
    }
    const bool had_force = before.force.norm() > 0;
    tick(bend, after);
    if (testing::Test::HasFatalFailure()) return;
    device.force_scale = force_scale;
    seen |= before.status;
    peak = std::max(peak, before.force.norm());
    released += had_force && (before.status & status_ramping_down) &&
                (before.status & (status_problem_lost | status_latched));
    // Whatever latched or disarmed it: armed again before long.
    if ((before.status & status_disarmed) && below(50) == 0)
      tick([](HapticInput& now) { now.device[0].sample.enable = false; });
  }
  EXPECT_GT(peak, 0.25 * device.max_force);
  EXPECT_GT(released, 0);
  const std::uint32_t all = status_disarmed | status_holding | status_ramping_down | status_ramping_up |
                            status_problem_old | status_problem_lost | status_gap | status_rejected |
                            status_latched | status_conflict | status_slew_limited | status_not_finite |
                            status_blending;
  EXPECT_EQ(seen & all, all);
}

INSTANTIATE_TEST_SUITE_P(Devices, SlewRows,
                         testing::Values(Limits{"touch", 3.3, 0, 200, 4}, Limits{"omega_6", 12, 0, 2000, 30},
                                         Limits{"premium", 8.5, 0.188, 400, 5}),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace hapticd
