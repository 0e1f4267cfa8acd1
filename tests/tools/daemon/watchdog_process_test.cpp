// The safety table (haptic/watchdog.h), each row against hapticd as a process, over real DDS.
//
// What the machine does to the clock is not the daemon's fault: thresholds are judged by the ages that each
// force carries, and changes only between forces of consecutive ticks.
#include <csignal>

#include <gtest/gtest.h>

#include "tests/tools/daemon/watchdog_fixture.h"

namespace hapticd {
namespace {

using namespace watchdog;

TEST_P(Watchdog, SilenceHoldsThenRampsThenDisarmsAndOnlyAnEdgeArmsAgain) {
  start();
  touch();
  const std::size_t from = client_->count();
  client_->silent(true);
  ASSERT_TRUE(client_->await(
      patience_ms, [](const Force& f) { return has(f, status_disarmed); }, from));
  bool held = false, ramped = false;
  const std::vector<Force> forces = client_->forces(from);
  for (std::size_t i = 1; i < forces.size(); ++i) {
    const Force &f = forces[i], &before = forces[i - 1];
    if (has(f, status_gap) || f.number != before.number + 1) continue;
    if (f.state_age_us >= 3'000 && f.state_age_us < 10'000) {
      held = true;
      EXPECT_TRUE(has(f, status_holding)) << f.state_age_us;
      if (has(before, status_holding)) {
        EXPECT_EQ(magnitude(f), magnitude(before));
      }
    } else if (f.state_age_us >= 10'000 && f.state_age_us < 100'000) {
      ramped = true;
      EXPECT_TRUE(has(f, status_ramping_down));
      EXPECT_LE(magnitude(f), magnitude(before));
      // Five ticks bring the gain to zero, however late they are.
      if (f.state_age_us > 20'000) {
        EXPECT_EQ(magnitude(f), 0) << f.state_age_us;
      }
    } else if (f.state_age_us >= 100'000) {
      EXPECT_TRUE(has(f, status_disarmed));
      EXPECT_EQ(magnitude(f), 0);
    }
  }
  EXPECT_TRUE(held);
  EXPECT_TRUE(ramped);
  expect_bounded(forces, touch_step, 3.3);

  // Back as if nothing had been, like a process that was stopped and continued: no force.
  client_->silent(false);
  const std::size_t back = client_->count();
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  for (const Force& f : client_->forces(back)) EXPECT_EQ(magnitude(f), 0);
  const std::size_t edge = client_->count();
  rearm();
  bool rising = false;
  for (const Force& f : client_->forces(edge)) rising = rising || has(f, status_ramping_up);
  EXPECT_TRUE(rising);
  expect_bounded(client_->forces(edge), touch_step, 3.3);
}

TEST_P(Watchdog, AHeldSimulationLeavesDampingThenNothingAndComesBackGently) {
  start();
  touch();
  for (const int hold_ms : {20, 100, 500}) {
    const std::size_t from = client_->count();
    daemon_->signal(SIGRTMIN, hold_ms);
    std::this_thread::sleep_for(std::chrono::milliseconds(hold_ms + 400));
    const std::vector<Force> forces = client_->forces(from);
    expect_bounded(forces, touch_step, 3.3);
    bool old = false, lost = false;
    int old_in_a_row = 0;
    for (const Force& f : forces) {
      const bool is_old = f.problem_age_ms >= 60.001f && f.problem_age_ms < 199.999f;
      old_in_a_row = is_old ? old_in_a_row + 1 : 0;
      if (is_old) {
        old = true;
        EXPECT_TRUE(has(f, status_problem_old | status_disarmed));
        // The client rests: −b v is zero once the old force has blended away (slew-limited as ever).
        if (old_in_a_row > 30) {
          EXPECT_LT(magnitude(f), 1e-3);
        }
      } else if (f.problem_age_ms >= 200.001f) {
        lost = true;
        EXPECT_TRUE(has(f, status_problem_lost));
        EXPECT_EQ(magnitude(f), 0);
      }
    }
    if (hold_ms >= 100) {
      EXPECT_TRUE(old);
    }
    // Without real-time rights a loaded machine may hold the simulation for longer than we did.
    if (hold_ms >= 500 || realtime_allowed()) {
      EXPECT_EQ(lost, hold_ms >= 500);
    }
    EXPECT_TRUE(
        client_->await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }))
        << "no force again after " << hold_ms << " ms";
  }
}

TEST_P(Watchdog, AGapOfTheLoopItselfIsAnnouncedAndNeverAStep) {
  start();
  touch();
  for (int i = 0; i < 3; ++i) {
    const std::size_t from = client_->count();
    daemon_->signal(SIGSTOP);
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    daemon_->signal(SIGCONT);
    ASSERT_TRUE(client_->await(
        patience_ms, [](const Force& f) { return has(f, status_gap); }, from));
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    expect_bounded(client_->forces(from), touch_step, 3.3);
    EXPECT_TRUE(
        client_->await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  }
}

TEST_P(Watchdog, AForceThatIsNotFiniteIsZeroAndLatches) {
  start();
  touch();
  const std::size_t from = client_->count();
  daemon_->signal(SIGRTMIN + 1, 0);
  ASSERT_TRUE(client_->await(
      patience_ms, [](const Force& f) { return has(f, status_not_finite); }, from));
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  expect_bounded(client_->forces(from), touch_step, 3.3);
  for (const Force& f : client_->forces(from))
    if (has(f, status_not_finite)) {
      EXPECT_TRUE(has(f, status_latched));
      EXPECT_EQ(magnitude(f), 0);
    }
  rearm();
}

TEST_P(Watchdog, NoForceExceedsTheDevicesMaximumOrItsSlew) {
  const std::string weak = log_.file("weak.yaml",
                                     "device: weak\nmax_force: 0.05\nmax_stiffness: 400\ndamping: 4\n"
                                     "workspace_radius: 0.1\nmax_force_rate: 2\nmax_speed: 2\n");
  start({"--device", weak});
  client_->enable(true);
  const std::size_t from = client_->count();
  client_->move_to(0.019, 60);
  ASSERT_TRUE(client_->await(
      patience_ms, [](const Force& f) { return has(f, status_saturated); }, from));
  client_->move_to(free_z, 20);
  client_->move_to(0.019, 20);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  const std::vector<Force> forces = client_->forces(from);
  expect_bounded(forces, 2e-3, 0.05);
  bool slewed = false;
  for (const Force& f : forces) slewed = slewed || has(f, status_slew_limited);
  EXPECT_TRUE(slewed);
}

TEST_P(Watchdog, ARemovalUnderLoadBlends) {
  start();
  touch();
  const std::size_t from = client_->count();
  client_->change([](State& s) { s.buttons = pedal_phaco; });
  EXPECT_TRUE(client_->await(
      patience_ms, [](const Force& f) { return has(f, status_blending); }, from));
  client_->change([](State& s) { s.buttons = 0; });
  expect_bounded(client_->forces(from), touch_step, 3.3);
}

INSTANTIATE_TEST_SUITE_P(Modes, Watchdog, testing::Values("tick", "event"),
                         [](const auto& p) { return std::string(p.param); });

}  // namespace
}  // namespace hapticd
