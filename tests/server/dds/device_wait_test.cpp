// Two ports of one loop in mode `event`: the first is waited on, and wakes for a state of either.
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <optional>
#include <thread>

#include <gtest/gtest.h>

#include "haptic/clock.h"
#include "server/dds/device_bridge.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

bool within_two_seconds(const std::function<bool()>& done) {
  for (int i = 0; i < 2000; ++i) {
    if (done()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

struct DeviceWait : testing::Test {
  Domain domain{static_cast<std::uint32_t>(getpid()) % 200, read_dds_profile("loopback")};
  Participant daemon{domain}, client{domain};
  Writer<hapticd_msg_DeviceState> writer{client};
  std::uint64_t number = 0;

  void connect() {
    ASSERT_TRUE(within_two_seconds([&] { return writer.matched() >= 2; }));
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  void send(std::uint32_t id) {
    hapticd_msg_DeviceState state{};
    state.device_id = id;
    state.number = ++number;
    state.orientation[3] = 1;
    state.enable = true;
    ASSERT_EQ(writer.write(state), DDS_RETCODE_OK);
  }
};

TEST_F(DeviceWait, TheLeaderWakesForAStateOfEitherAndOnlyTheirs) {
  DdsDevicePort leader(daemon, 3, true), follower(daemon, 4, true, {}, &leader);
  DdsDevicePort* const ports[] = {&leader, &follower};
  connect();
  DeviceSample sample;
  for (int n = 0; n < 40; ++n) {
    const int i = n % 2;
    send(static_cast<std::uint32_t>(3 + i));
    const std::int64_t begun = monotonic_ns();
    const std::int64_t arrived = leader.await(begun + 2'000 * ms, {});
    ASSERT_NE(arrived, 0) << n;
    EXPECT_LE(arrived, monotonic_ns());
    EXPECT_GT(arrived, begun - 2'000 * ms);
    EXPECT_LT(monotonic_ns() - begun, 1'000 * ms) << "woken by the state, not by the time";
    const std::int64_t now = monotonic_ns();
    EXPECT_TRUE(ports[i]->take(now, sample)) << n;
    EXPECT_EQ(sample.sequence, number);
    EXPECT_FALSE(ports[1 - i]->take(now, sample)) << n;
    EXPECT_TRUE(ports[i]->presence().connected);
  }
  // Nobody else's state, and no state: the whole time.
  send(5);
  const std::int64_t begun = monotonic_ns();
  EXPECT_EQ(leader.await(begun + 30 * ms, {}), 0);
  EXPECT_GE(monotonic_ns() - begun, 30 * ms);
}

// What came before the wait, at either, is not slept over.
TEST_F(DeviceWait, AStateThatIsThereAlreadyIsNotSleptOver) {
  DdsDevicePort leader(daemon, 3, true), follower(daemon, 4, true, {}, &leader);
  connect();
  DeviceSample sample;
  for (const std::uint32_t id : {3u, 4u}) {
    leader.take(monotonic_ns(), sample);
    follower.take(monotonic_ns(), sample);
    send(id);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    const std::int64_t begun = monotonic_ns();
    EXPECT_NE(leader.await(begun + 2'000 * ms, {}), 0);
    EXPECT_LT(monotonic_ns() - begun, 1'000 * ms);
    // Still there until it is taken.
    EXPECT_NE(leader.await(monotonic_ns() + 2'000 * ms, {}), 0);
  }
}

// One that was answered a moment ago waits for its time; the other one is answered at once meanwhile.
TEST_F(DeviceWait, WhoseTimeHasNotComeWaitsAndHoldsUpNobody) {
  DdsDevicePort leader(daemon, 3, true), follower(daemon, 4, true, {}, &leader);
  connect();
  for (const int early : {0, 1}) {
    DeviceSample sample;
    leader.take(monotonic_ns(), sample);
    follower.take(monotonic_ns(), sample);
    const std::int64_t begun = monotonic_ns(), earliest = begun + 300 * ms;
    EachInstrument<std::int64_t> times;
    times[early] = earliest;
    send(static_cast<std::uint32_t>(3 + early));
    std::thread other([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      send(static_cast<std::uint32_t>(4 - early));
    });
    const std::int64_t due = leader.await(begun + 2'000 * ms, times);
    other.join();
    EXPECT_GT(due, begun + 10 * ms);
    EXPECT_LT(due, earliest);
    DdsDevicePort& came = early == 0 ? follower : leader;
    EXPECT_TRUE(came.take(monotonic_ns(), sample));
    // Then nothing is left but the early one, at its time to the nanosecond.
    EXPECT_EQ(leader.await(begun + 2'000 * ms, times), earliest);
    EXPECT_GE(monotonic_ns(), earliest);
    // With both there as well.
    send(static_cast<std::uint32_t>(4 - early));
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    times[early] = times[1 - early] = monotonic_ns() + 50 * ms;
    EXPECT_EQ(leader.await(begun + 3'000 * ms, times), times[0]);
  }
}

// States of both keep coming while the follower goes: nothing is woken that is no more.
TEST_F(DeviceWait, AFollowerMayEndWhileItsStatesCome) {
  DdsDevicePort leader(daemon, 3, true);
  std::atomic<bool> over{false};
  std::thread sending([&] {
    while (!over) {
      send(3);
      send(4);
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
  });
  DeviceSample sample;
  for (int n = 0; n < 5; ++n) {
    {
      std::optional<DdsDevicePort> follower(std::in_place, daemon, 4u, true, std::nullopt, &leader);
      EXPECT_TRUE(within_two_seconds([&] { return follower->take(monotonic_ns(), sample); }));
    }
    leader.take(monotonic_ns(), sample);
    EXPECT_NE(leader.await(monotonic_ns() + 2'000 * ms, {}), 0);
  }
  over = true;
  sending.join();
}

}  // namespace
}  // namespace hapticd
