// The rows of the safety table that are about what a client does: lies, second writers, floods, leaving.
#include <functional>
#include <limits>
#include <utility>

#include <gtest/gtest.h>

#include "haptic/clock.h"
#include "tests/tools/daemon/watchdog_fixture.h"

namespace hapticd {
namespace {

using namespace watchdog;

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
    // Down within the slew limit, which is less where one arrival follows another at once, and then nothing.
    double before = std::numeric_limits<double>::infinity();
    for (const Force& f : client_->forces(again))
      if (has(f, status_latched)) {
        EXPECT_LE(magnitude(f), has(f, status_ramping_down) ? before : 0) << what;
        before = magnitude(f);
      }
    EXPECT_EQ(before, 0) << what;
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

}  // namespace
}  // namespace hapticd
