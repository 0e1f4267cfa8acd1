// Who writes a device's forces, as its client and as a daemon hear it: over Cyclone, in one process, on
// loopback.
#include "server/dds/force_reader.h"

#include <unistd.h>

#include <chrono>
#include <functional>
#include <thread>

#include <gtest/gtest.h>

#include "haptic/clock.h"
#include "server/dds/device_bridge.h"

namespace hapticd {
namespace {

using Force = hapticd_msg_ForceCommand;
constexpr std::uint32_t device_id = 7;
constexpr std::int64_t ms = 1'000'000;

void pause(int milliseconds) { std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds)); }

bool within_two_seconds(const std::function<bool()>& done) {
  for (int i = 0; i < 2000; ++i, pause(1))
    if (done()) return true;
  return false;
}

// A daemon's force writer, in a participant of its own.
struct Source {
  Participant participant;
  Writer<Force> writer;
  Force force{};

  Source(const Domain& domain, double newtons, std::uint32_t id = device_id)
      : participant(domain), writer(participant) {
    force.device_id = id;
    force.force[2] = newtons;
  }
  void send() {
    ++force.number;
    ASSERT_EQ(writer.write(force), DDS_RETCODE_OK);
  }
};

struct Forces : testing::Test {
  Domain domain{static_cast<std::uint32_t>(getpid()) % 200, read_dds_profile("loopback")};
  Participant own{domain};

  static void meet(Source& source, int readers) {
    ASSERT_TRUE(within_two_seconds([&] { return source.writer.matched() >= readers; }));
  }
  // Newton by newton, what came since the last call.
  static std::vector<double> taken(ForceReader& reader) {
    std::array<Force, forces_kept> forces;
    std::array<dds_sample_info_t, forces_kept> infos;
    std::vector<double> out;
    const int n = reader.take_into(forces, infos);
    for (std::size_t i = 0; static_cast<int>(i) < n; ++i)
      if (infos[i].valid_data) out.push_back(forces[i].force[2]);
    return out;
  }
};

TEST_F(Forces, AClientKeepsToTheDaemonHeardFirstAndCountsTheOther) {
  ForceReader reader(own, device_id, ForceReader::Side::client);
  Source first(domain, 1), second(domain, 2), elsewhere(domain, 3, device_id + 1);
  for (Source* source : {&first, &second, &elsewhere}) meet(*source, 1);
  first.send();
  ASSERT_TRUE(within_two_seconds([&] { return taken(reader) == std::vector<double>{1}; }));
  EXPECT_FALSE(reader.stranger(monotonic_ns()));
  // What is refused does not take the place of what is kept.
  first.send();
  for (int i = 0; i < 20; ++i) {
    second.send();
    elsewhere.send();
  }
  ASSERT_TRUE(within_two_seconds([&] { return reader.strange_forces() == 20; }));
  EXPECT_TRUE(reader.stranger(monotonic_ns()));
  EXPECT_EQ(taken(reader), std::vector<double>{1});
  // The first has fallen silent: its successor is heard.
  pause(150);
  second.send();
  EXPECT_TRUE(within_two_seconds([&] { return taken(reader) == std::vector<double>{2}; }));
  EXPECT_EQ(reader.strange_forces(), 20u);
  EXPECT_FALSE(reader.stranger(monotonic_ns() + 500 * ms));
}

// With the newest alone kept, states that were answered would count as lost.
TEST_F(Forces, AClientThatWakesLateFindsTheForceOfEachTick) {
  ForceReader reader(own, device_id, ForceReader::Side::client);
  Source daemon(domain, 0), last(domain, 9);
  meet(daemon, 1);
  meet(last, 1);
  for (int tick = 1; tick <= 12; ++tick) {
    daemon.force.force[2] = tick;
    daemon.send();
  }
  last.send();  // a stranger: all before it have arrived once it is refused
  ASSERT_TRUE(within_two_seconds([&] { return reader.strange_forces() == 1; }));
  EXPECT_EQ(taken(reader), (std::vector<double>{5, 6, 7, 8, 9, 10, 11, 12}));
}

TEST_F(Forces, ADaemonHearsAnotherWriterOfItsDeviceAndNotItself) {
  DdsDevicePort port(own, device_id), world_session(own, device_id + 1);
  Source other(domain, 1, device_id + 1), rival(domain, 0);
  meet(other, 2);
  meet(rival, 2);
  DeviceSample sample;
  std::int64_t now = monotonic_ns();
  const auto presence = [&] {
    port.take(now = std::max(now, monotonic_ns()), sample);
    return port.presence();
  };
  // Matched writers that write nothing for this device are nobody: one that was killed lingers so.
  for (int i = 0; i < 20; ++i) {
    port.write({});
    world_session.write({});
    other.send();
    pause(1);
  }
  EXPECT_FALSE(presence().rival);
  EXPECT_FALSE(presence().settled);
  EXPECT_EQ(port.foreign_forces(), 0u);
  rival.send();
  const std::int64_t sent = monotonic_ns();
  ASSERT_TRUE(within_two_seconds([&] { return presence().rival; }));
  EXPECT_LT(monotonic_ns() - sent, 100 * ms);
  EXPECT_EQ(port.foreign_forces(), 1u);
  EXPECT_EQ(world_session.foreign_forces(), 20u);
  now += 510 * ms;
  EXPECT_FALSE(presence().rival);
  EXPECT_TRUE(presence().settled);
}

}  // namespace
}  // namespace hapticd
