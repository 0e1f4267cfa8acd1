// The safety table (haptic/watchdog.h), each row against hapticd as a process, over real DDS.
//
// What the machine does to the clock is not the daemon's fault: thresholds are judged by the ages that each
// force carries, and changes only between forces of consecutive ticks.
#include <csignal>
#include <filesystem>
#include <fstream>
#include <limits>
#include <optional>

#include <gtest/gtest.h>
#include <linux/capability.h>
#include <sys/prctl.h>
#include <unistd.h>

#include "haptic/device.h"
#include "tests/tools/fake_daemon.h"
#include "tests/tools/run_command.h"
#include "tests/tools/scripted_client.h"
#include "tools/cli/child.h"

namespace hapticd {
namespace {

using Force = ScriptedClient::Force;
using State = ScriptedClient::State;

constexpr double free_z = 0.0300,
                 touching_z = 0.0215;      // a 3 mm ball above, and 1.5 mm into, the cube of 20 mm
constexpr double touch_step = 200 * 1e-3;  // config/devices/touch.yaml: N/s in a tick
constexpr int patience_ms = 20'000;        // until something must have come, on whatever machine

double magnitude(const Force& f) { return ScriptedClient::magnitude(f); }
bool has(const Force& f, std::uint32_t bits) { return (f.status & bits) != 0; }

// Parameter: the daemon's mode.
class Watchdog : public testing::TestWithParam<const char*> {
 protected:
  Watchdog() : domain_(test_domain(), read_dds_profile("loopback")), participant_(domain_) {}

  void start(std::vector<std::string> more = {}) {
    std::vector<std::string> command = {BIN_DIR "/hapticd", SOURCE_DIR "/config/scenes/cube/cube.yaml",
                                        "--domain",         std::to_string(domain_.id()),
                                        "--mode",           GetParam(),
                                        "--test-hooks"};
    command.insert(command.end(), more.begin(), more.end());
    daemon_.emplace(ChildSettings{.command = command, .output = log_.file("daemon.log")});
    client_.emplace(participant_);
    ASSERT_TRUE(client_->await(patience_ms, [](const Force&) { return true; })) << "no force came";
  }
  // enable false, until the daemon has seen it, and true.
  void edge() {
    client_->enable(false);
    EXPECT_TRUE(client_->await(patience_ms, [](const Force& f) { return has(f, status_disarmed); }));
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    client_->enable(true);
  }
  // Armed, and pressed into the cube.
  void touch() {
    edge();
    client_->move_to(touching_z, 300);
    ASSERT_TRUE(
        client_->await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  }
  // No two forces of consecutive ticks further apart than the device's slew limit, none above its maximum.
  static void expect_bounded(const std::vector<Force>& forces, double step, double maximum) {
    for (std::size_t i = 0; i < forces.size(); ++i) {
      ASSERT_TRUE(std::isfinite(magnitude(forces[i])));
      ASSERT_LE(magnitude(forces[i]), maximum * (1 + 1e-9));
      if (i == 0 || forces[i].number != forces[i - 1].number + 1) continue;
      // What ends at once is exempt: zero is always allowed.
      if (magnitude(forces[i]) == 0) continue;
      Vec3 change;
      for (int k = 0; k < 3; ++k) change[k] = forces[i].force[k] - forces[i - 1].force[k];
      ASSERT_LE(change.norm(), step * (1 + 1e-6)) << "at tick " << forces[i].number;
    }
  }
  void rearm() {
    edge();
    EXPECT_TRUE(
        client_->await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  }

  Domain domain_;
  Participant participant_;
  ScratchDirectory log_;
  std::optional<Child> daemon_;
  std::optional<ScriptedClient> client_;
};

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

TEST_P(Watchdog, ALyingStateIsRefusedAndThreeInARowLatch) {
  start();
  touch();
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  const std::pair<const char*, std::function<void(State&)>> lies[] = {
      {"NaN", [=](State& s) { s.position[1] = nan; }},
      {"infinite", [=](State& s) { s.position[0] = inf; }},
      {"NaN quaternion", [=](State& s) { s.orientation[2] = nan; }},
      {"zero quaternion", [](State& s) { s.orientation[3] = 0; }},
      {"long quaternion", [](State& s) { s.orientation[3] = 1e300; }},
      {"number going back", [](State& s) { s.number -= 1000; }},
      {"jump", [](State& s) { s.position[0] += 0.5; }},
  };
  for (const auto& [what, lie] : lies) {
    const std::size_t from = client_->count();
    // One that is overtaken by the next before the tick is seen by nobody: again, then.
    bool refused = false;
    for (int i = 0; i < 20 && !refused; ++i) {
      client_->bend(1, lie);
      refused = client_->await(
          100, [](const Force& f) { return has(f, status_rejected); }, from);
    }
    EXPECT_TRUE(refused) << what;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    for (const Force& f : client_->forces(from)) EXPECT_FALSE(has(f, status_latched)) << what;

    const std::size_t again = client_->count();
    client_->bend(50, lie);
    EXPECT_TRUE(client_->await(
        patience_ms, [](const Force& f) { return has(f, status_latched); }, again))
        << what;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    for (const Force& f : client_->forces(again))
      if (has(f, status_latched)) {
        EXPECT_EQ(magnitude(f), 0) << what;
      }
    expect_bounded(client_->forces(from), touch_step, 3.3);
    rearm();
  }
}

TEST_P(Watchdog, ASecondWriterIsAConflictAndTheFirstFeelsNothingOfIt) {
  start();
  touch();
  const double felt = magnitude(client_->forces().back());
  const std::size_t from = client_->count();
  {
    const Participant other(domain_);
    ScriptedClient second(other);
    second.change([](State& s) {
      s.number += 1'000'000'000;
      s.position[2] = 0.010;
      s.enable = true;
    });
    EXPECT_TRUE(client_->await(
        patience_ms, [](const Force& f) { return has(f, status_conflict); }, from));
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  for (const Force& f : client_->forces(from)) {
    EXPECT_LT(f.echo_number, 1'000'000'000u);
    if (!has(f, status_gap | status_holding | status_ramping_down | status_disarmed)) {
      EXPECT_NEAR(magnitude(f), felt, 0.3 * felt);
    }
  }
  expect_bounded(client_->forces(from), touch_step, 3.3);
}

TEST_P(Watchdog, EnableFalseAndDisposeAreZeroAtOnce) {
  start();
  touch();
  std::uint64_t last = 0;
  std::size_t from = client_->count();
  client_->change([&](State& s) {
    last = s.number;
    s.enable = false;
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  for (const Force& f : client_->forces(from))
    if (f.echo_number > last) {
      EXPECT_EQ(magnitude(f), 0);
      EXPECT_TRUE(has(f, status_disarmed));
    }
  rearm();
  from = client_->count();
  client_->dispose();
  ASSERT_TRUE(client_->await(
      patience_ms, [](const Force& f) { return has(f, status_disarmed); }, from));
  for (const Force& f : client_->forces(from))
    if (has(f, status_disarmed)) {
      EXPECT_EQ(magnitude(f), 0);
    }
  // No ramp, no hold: from full force to nothing in one tick.
  const std::vector<Force> forces = client_->forces(from);
  for (std::size_t i = 1; i < forces.size(); ++i)
    if (has(forces[i], status_disarmed) && !has(forces[i - 1], status_disarmed) &&
        forces[i - 1].state_age_us < 3'000) {
      EXPECT_FALSE(has(forces[i - 1], status_ramping_down));
      EXPECT_GT(magnitude(forces[i - 1]), 0.02);
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

TEST_P(Watchdog, AFloodIsAnsweredAtTwoKilohertzAndNoFaster) {
  start();
  touch();
  client_->silent(true);
  std::uint64_t number = 0;
  client_->change([&](State& s) { number = s.number + 1'000'000; });
  Writer<State> writer(participant_);  // another writer of the same id: the worst that the port has to refuse
  State state{};
  state.orientation[3] = 1;
  const std::size_t from = client_->count();
  const std::int64_t begun = monotonic_ns();
  for (int i = 0; i < 5000; ++i) {
    state.number = ++number;
    writer.write(state);
    while (monotonic_ns() - begun < 100'000 * i) std::this_thread::yield();
  }
  const double seconds = 1e-9 * static_cast<double>(monotonic_ns() - begun);
  const std::vector<Force> forces = client_->forces(from);
  ASSERT_FALSE(forces.empty());
  const double ticks = static_cast<double>(forces.back().number - forces.front().number);
  EXPECT_LE(ticks, 1.05 * (std::string(GetParam()) == "event" ? 2000 : 1000) * seconds);
  expect_bounded(forces, touch_step, 3.3);
}

TEST_P(Watchdog, TwoDevicesHaveWatchdogsAndTissueOfTheirOwn) {
  start({"--also", "falcon"});
  touch();
  const Participant other(domain_);
  ScriptedClient second(other, 1);
  ASSERT_TRUE(second.await(patience_ms, [](const Force&) { return true; }));
  second.enable(true);
  second.move_to(touching_z, 300);
  ASSERT_TRUE(second.await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  const double felt = magnitude(client_->forces().back());
  const std::size_t from = client_->count();
  second.bend(100, [](State& s) { s.position[0] = std::numeric_limits<double>::quiet_NaN(); });
  EXPECT_TRUE(
      second.await(patience_ms, [](const Force& f) { return has(f, status_latched) && magnitude(f) == 0; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  for (const Force& f : client_->forces(from)) {
    EXPECT_FALSE(has(f, status_latched | status_rejected | status_conflict));
    if (f.status == 0) {
      EXPECT_NEAR(magnitude(f), felt, 0.3 * felt);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Modes, Watchdog, testing::Values("tick", "event"),
                         [](const auto& p) { return std::string(p.param); });

// Without the privileges it asks for, the daemon works, says what is missing, and says so to every client.
TEST(Degraded, WithoutPrivilegesTheDaemonAnnouncesItAndAnswers) {
  if (geteuid() != 0) GTEST_SKIP() << "only root has privileges to do without";
  const Domain domain(test_domain(), read_dds_profile("loopback"));
  const Participant participant(domain);
  const ScratchDirectory scratch;
  const std::string log = scratch.file("daemon.log");
  Child daemon(
      {.command = {"setpriv", "--bounding-set", "-sys_nice,-ipc_lock,-sys_resource", "prlimit",
                   "--memlock=65536", "--rtprio=0", BIN_DIR "/hapticd",
                   SOURCE_DIR "/config/scenes/cube/cube.yaml", "--domain", std::to_string(domain.id())},
       .output = log});
  ScriptedClient client(participant);
  ASSERT_TRUE(client.await(patience_ms, [](const Force&) { return true; }));
  client.enable(true);
  client.move_to(touching_z, 300);
  EXPECT_TRUE(client.await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  Reader<hapticd_msg_ServerStatus> status(participant);
  std::string refused;
  for (int i = 0; i < 3000 && refused.empty(); ++i) {
    usleep(1000);
    status.take_each(
        [&](const hapticd_msg_ServerStatus& m, const dds_sample_info_t&) { refused = m.refused; });
  }
  EXPECT_NE(refused.find("SCHED_FIFO"), std::string::npos) << refused;
  EXPECT_NE(refused.find("mlockall"), std::string::npos) << refused;
  std::ifstream in(log);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  EXPECT_NE(text.find("not granted: SCHED_FIFO"), std::string::npos) << text;
  EXPECT_NE(text.find("degraded"), std::string::npos) << text;
}

}  // namespace
}  // namespace hapticd
