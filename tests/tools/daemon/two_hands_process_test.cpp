// Two hands in one cube, over real DDS: whatever the one client does, the other's force changes by at most
// its slew limit in a tick, stays within its limits, and ends as that of its hand alone.
#include <csignal>
#include <fstream>
#include <iterator>
#include <limits>
#include <tuple>

#include <gtest/gtest.h>

#include "tests/tools/daemon/watchdog_fixture.h"

namespace hapticd {
namespace {

using namespace watchdog;

// The scene with a device whose slew limit is near what a hand does to the other one: 2 mN in a tick.
constexpr double largest = 0.5, step = 2e-3;
constexpr const char* weak =
    "device: weak\nmax_force: 0.5\nmax_stiffness: 400\ndamping: 4\nworkspace_radius: 0.1\nmax_force_rate: 2\n"
    "max_speed: 2\n";

std::string weak_scene(const ScratchDirectory& scratch) {
  const std::string folder = SOURCE_DIR "/config/scenes/cube/";
  std::ifstream in(folder + "two_hands.yaml");
  std::string text{std::istreambuf_iterator<char>(in), {}};
  const auto replace = [&text](const std::string& what, const std::string& with) {
    for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += with.size())
      text.replace(at, what.size(), with);
  };
  replace("device: touch", "device: " + scratch.file("weak.yaml", weak));
  replace("cube.msh", folder + "cube.msh");
  replace("press.csv", folder + "press.csv");
  return scratch.file("scene.yaml", text);
}

void pause(int milliseconds) { std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds)); }

// Parameters: the daemon's mode; the device of the client that behaves, A. B is the other.
class TwoHandsWatchdog : public testing::TestWithParam<std::tuple<const char*, int>> {
 protected:
  static constexpr double same = 0.02;  // relative, of two steady forces
  static constexpr int lift_ms = 1100;  // that `lift` takes

  TwoHandsWatchdog()
      : domain_(test_domain(), read_dds_profile("loopback")), own_(domain_), others_(domain_) {}

  std::uint32_t a() const { return static_cast<std::uint32_t>(std::get<1>(GetParam())); }
  std::uint32_t b() const { return 1 - a(); }

  // A is armed and pressed into the cube; `alone_` is what it feels.
  void start() {
    daemon_.emplace(
        ChildSettings{.command = {BIN_DIR "/hapticd", weak_scene(log_), "--domain",
                                  std::to_string(domain_.id()), "--mode", std::get<0>(GetParam())},
                      .output = log_.file("daemon.log")});
    first_.emplace(own_, a());
    press(*first_);
    pause(500);
    alone_ = steady_again();
    ASSERT_GT(alone_, 0.02);
  }
  // A client that the machine held up for 100 ms is disarmed, and presses once more.
  void press(ScriptedClient& client) const {
    ASSERT_TRUE(client.await(patience_ms, [](const Force&) { return true; })) << "no force came";
    const auto pressed = [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; };
    for (int tries = 0; tries < 5; ++tries) {
      client.enable(false);
      ASSERT_TRUE(client.await(patience_ms, [](const Force& f) { return has(f, status_disarmed); }));
      client.move_to(free_z, 30);
      client.enable(true);
      ASSERT_TRUE(client.await(patience_ms, [](const Force& f) { return !has(f, status_disarmed); }));
      client.move_to(touching_z, 300);
      if (client.await(patience_ms / 5, pressed)) return;
    }
    FAIL() << "it cannot press";
  }
  // One that the machine held up for long is disarmed.
  static bool held_up(const ScriptedClient& client) { return client.longest_pause_ms() >= 50; }
  void press_again(ScriptedClient& client) const {
    const std::vector<Force> last = client.forces(client.count() - 1);
    if (held_up(client) && !last.empty() && has(last.back(), status_disarmed)) press(client);
  }
  // B is a client of this process, which presses too; `together_` is what A then feels.
  void second() {
    second_.emplace(others_, b());
    press(*second_);
    felt_together();
  }
  // B is a process, and another client only listens.
  void second_process() {
    second_.emplace(others_, b(), true);
    process_.emplace(ChildSettings{
        .command = {BIN_DIR "/haptic", "abuse", "--attack", "dying", "--seconds", "60", "--domain",
                    std::to_string(domain_.id()), "--attacked", std::to_string(b())},
        .output = log_.file("client.log")});
    ASSERT_TRUE(
        second_->await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
    felt_together();
  }
  void felt_together() {
    pause(500);
    together_ = steady_again();
    // Through the tissue: otherwise nothing below would tell one hand from two.
    ASSERT_GT(std::abs(together_ - alone_), 2 * same * alone_);
    from_a_ = first_->count();
    from_b_ = second_->count();
  }
  // Mean of a hundred forces or more that nothing troubled and that agree, of several steps of the
  // simulation: the machine may hold up anybody for a while, and a simulation that stands still has steady
  // forces, too.
  double steady() {
    constexpr std::size_t fewest = 100;
    constexpr std::uint64_t steps = 6;
    for (int waited = 0; waited < patience_ms; waited += 10, pause(10)) {
      press_again(*first_);
      const std::vector<Force> forces = first_->forces();
      double sum = 0, least = HUGE_VAL, most = 0;
      for (std::size_t n = 1; n <= forces.size(); ++n) {
        const Force& f = forces[forces.size() - n];
        if (f.status != 0) break;
        sum += magnitude(f);
        least = std::min(least, magnitude(f));
        most = std::max(most, magnitude(f));
        if (!(most - least < 0.2 * same * most)) break;
        if (n >= fewest && f.step + steps <= forces.back().step) return sum / static_cast<double>(n);
      }
    }
    ADD_FAILURE() << "no steady force";
    return 0;
  }
  // What one press ends with, and the next. A ball may rest between other samples where the machine had it
  // let go for a moment (0.0481 and 0.0491 N here): that is no reference.
  double steady_again() {
    double last = steady();
    for (int waited = 0; waited < patience_ms && !HasFailure(); waited += lift_ms) {
      lift();
      const double next = steady();
      if (std::abs(next - last) <= same / 4 * next) return next;
      last = next;
    }
    ADD_FAILURE() << "each press ends otherwise";
    return 0;
  }
  void lift() {
    first_->move_to(free_z, 300);
    first_->move_to(touching_z, 300);
    pause(500);
  }
  std::vector<Force> of_b() const { return second_->forces(from_b_); }

  // Since B pressed too. Zero is no excuse for a step here: A's client asks for force all the time.
  void expect_unharmed() const {
    const std::vector<Force> forces = first_->forces(from_a_);
    ASSERT_GT(forces.size(), 100u);
    for (std::size_t i = 0; i < forces.size(); ++i) {
      const Force& f = forces[i];
      ASSERT_TRUE(std::isfinite(magnitude(f)) &&
                  std::isfinite(std::hypot(f.torque[0], f.torque[1], f.torque[2])));
      ASSERT_LE(magnitude(f), largest * (1 + 1e-9));
      if (has(f, status_disarmed) && held_up(*first_))
        GTEST_SKIP() << "the machine held up the client that behaves for " << first_->longest_pause_ms()
                     << " ms";
      ASSERT_FALSE(
          has(f, status_disarmed | status_latched | status_rejected | status_conflict | status_not_finite))
          << f.status << " at tick " << f.number;
      if (i == 0 || f.number != forces[i - 1].number + 1) continue;
      const Vec3 change(f.force[0] - forces[i - 1].force[0], f.force[1] - forces[i - 1].force[1],
                        f.force[2] - forces[i - 1].force[2]);
      ASSERT_LE(change.norm(), step * (1 + 1e-6)) << "at tick " << f.number;
    }
  }
  // Ends there; on its way a held-up simulation may seem to rest. Where it rests between other samples it is
  // pressed in once more.
  void expect_steady(double expected) {
    expect_unharmed();
    double found = 0;
    for (int waited = 0; waited < patience_ms && !IsSkipped() && !HasFailure(); waited += lift_ms) {
      found = steady();
      if (std::abs(found - expected) <= same * alone_) return;
      lift();
    }
    if (!IsSkipped()) {
      EXPECT_NEAR(found, expected, same * alone_);
    }
  }
  void expect_alone() { expect_steady(alone_); }
  void expect_together() {
    press_again(*second_);
    expect_steady(together_);
  }

  // B's forces by the age of its state, as the table says; between consecutive ticks within its slew limit.
  void expect_silence_of_b() const {
    bool disarmed = false;
    const std::vector<Force> forces = of_b();
    const double held = magnitude(forces.front());
    for (const Force& f : forces) {
      // Five ticks bring the gain to zero, and the slew limit the force.
      if (f.state_age_us > 10'000 + 1e3 * held / step + 15'000) {
        EXPECT_EQ(magnitude(f), 0) << f.state_age_us;
      }
      if (f.state_age_us >= 100'000) {
        EXPECT_TRUE(has(f, status_disarmed)) << f.state_age_us;
      }
      disarmed = disarmed || has(f, status_disarmed);
    }
    EXPECT_TRUE(disarmed);
    expect_bounded(forces, step, largest);
  }
  bool b_is(std::uint32_t bits) {
    return second_->await(
        patience_ms, [bits](const Force& f) { return has(f, bits); }, from_b_);
  }

  Domain domain_;
  Participant own_, others_;
  ScratchDirectory log_;
  std::optional<Child> daemon_, process_;
  std::optional<ScriptedClient> first_, second_;
  double alone_ = 0, together_ = 0;
  std::size_t from_a_ = 0, from_b_ = 0;
};

TEST_P(TwoHandsWatchdog, AKilledClientIsOutOfTheTissueAndTheOtherFeelsItsOwnHandAlone) {
  start();
  second_process();
  process_->signal(SIGKILL);
  ASSERT_TRUE(b_is(status_disarmed));
  pause(1000);
  expect_silence_of_b();
  expect_alone();
}

TEST_P(TwoHandsWatchdog, AStoppedClientIsOutOfTheTissueAndStaysOutWhenItGoesOn) {
  start();
  second_process();
  process_->signal(SIGSTOP);
  ASSERT_TRUE(b_is(status_disarmed));
  expect_silence_of_b();
  process_->signal(SIGCONT);
  const std::size_t on = second_->count();
  pause(1000);
  for (const Force& f : second_->forces(on)) ASSERT_EQ(magnitude(f), 0);
  expect_alone();
}

TEST_P(TwoHandsWatchdog, AClientThatLiesIsLatchedAndTheOtherNeverFeelsANumberThatIsNone) {
  start();
  second();
  second_->bend(200, [](State& s) { s.position[0] = std::numeric_limits<double>::quiet_NaN(); });
  ASSERT_TRUE(b_is(status_latched));
  pause(1000);
  for (const Force& f : of_b())
    if (has(f, status_latched) && !has(f, status_ramping_down)) {
      ASSERT_EQ(magnitude(f), 0);
    }
  expect_bounded(of_b(), step, largest);
  ASSERT_TRUE(has(of_b().back(), status_latched)) << "whatever it sends meanwhile";
  expect_alone();

  // Armed again, it presses again.
  second_->enable(false);
  ASSERT_TRUE(second_->await(patience_ms, [](const Force& f) { return !has(f, status_latched); }));
  pause(30);
  second_->enable(true);
  ASSERT_TRUE(
      second_->await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  pause(1000);
  expect_together();
}

// The first state of a client has nothing that it could be compared with.
TEST_P(TwoHandsWatchdog, AnAbsurdPlaceOfANewClientIsNothingToTheOther) {
  start();
  for (const double absurd : {1e3, 1e150, 1e300}) {
    second_.emplace(others_, b(), true);
    second_->change([absurd](State& s) {
      s.enable = true;
      s.position[0] = s.position[1] = s.position[2] = absurd;
    });
    from_a_ = first_->count();
    from_b_ = second_->count();
    second_->silent(false);
    pause(500);
    for (const Force& f : of_b()) ASSERT_EQ(magnitude(f), 0) << absurd;
    expect_alone();
    second_->leave();
  }
}

// Its own client, and then a stranger for its device: both at 50 kHz.
TEST_P(TwoHandsWatchdog, AFloodForOneDeviceIsNothingToTheOther) {
  start();
  second();
  second_->flood(50);
  pause(500);
  second_->flood(1);
  for (const Force& f : of_b()) ASSERT_FALSE(has(f, status_latched | status_rejected));
  pause(300);
  expect_together();

  from_b_ = second_->count();
  {
    ScriptedClient stranger(others_, b(), true);
    stranger.change([](State& s) {
      s.enable = true;
      s.position[2] = 0.010;
      s.number += 1'000'000'000;
    });
    stranger.flood(50);
    stranger.silent(false);
    ASSERT_TRUE(b_is(status_conflict));
    pause(500);
  }
  pause(300);
  expect_together();
}

TEST_P(TwoHandsWatchdog, AClientThatLetsGoIsOutAtOnce) {
  start();
  second();
  std::uint64_t last = 0;
  second_->change([&](State& s) {
    last = s.number;
    s.enable = false;
  });
  ASSERT_TRUE(b_is(status_disarmed));
  pause(1000);
  for (const Force& f : of_b())
    if (f.echo_number > last) {
      ASSERT_EQ(magnitude(f), 0);
    }
  expect_alone();
}

TEST_P(TwoHandsWatchdog, ASecondClientForOneDeviceIsNothingToEither) {
  start();
  second();
  {
    ScriptedClient stranger(others_, b(), true);
    stranger.change([](State& s) {
      s.enable = true;
      s.position[2] = 0.010;
      s.number += 1'000'000'000;
    });
    stranger.silent(false);
    ASSERT_TRUE(b_is(status_conflict));
    pause(300);
  }
  pause(300);
  for (const Force& f : of_b()) ASSERT_LT(f.echo_number, 1'000'000'000u);
  expect_bounded(of_b(), step, largest);
  expect_together();
}

INSTANTIATE_TEST_SUITE_P(Either, TwoHandsWatchdog,
                         testing::Combine(testing::Values("tick", "event"), testing::Values(0, 1)),
                         [](const auto& p) {
                           return std::string(std::get<0>(p.param)) +
                                  (std::get<1>(p.param) == 0 ? "_first" : "_second");
                         });

}  // namespace
}  // namespace hapticd
