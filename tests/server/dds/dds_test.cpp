// Client and daemon over Cyclone, in one process, on loopback, in a domain of this process's own.
#include "server/dds/dds.h"

#include <unistd.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <stdexcept>
#include <thread>

#include <gtest/gtest.h>

#include "haptic/clock.h"
#include "server/dds/device_bridge.h"
#include "server/os/realtime.h"
#include "tests/support/malloc_guard.h"

namespace hapticd {
namespace {

constexpr std::uint32_t device_id = 7;
constexpr std::int64_t ms = 1'000'000;

bool within_two_seconds(const std::function<bool()>& done) {
  for (int i = 0; i < 2000; ++i) {
    if (done()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return false;
}

// A device driver: its own participant, a state writer and a force reader.
struct Client {
  Participant participant;
  Writer<hapticd_msg_DeviceState> writer;
  Reader<hapticd_msg_ForceCommand> reader;
  hapticd_msg_DeviceState state{};

  explicit Client(const Domain& domain, std::uint32_t id = device_id)
      : participant(domain), writer(participant), reader(participant) {
    state.device_id = id;
    state.orientation[3] = 1;
    state.enable = true;
  }
  void send() {
    ++state.number;
    ASSERT_EQ(writer.write(state), DDS_RETCODE_OK);
  }
};

struct Dds : testing::Test {
  Domain domain{static_cast<std::uint32_t>(getpid()) % 200, read_dds_profile("loopback")};
  Participant daemon{domain};
  DdsDevicePort port{daemon, device_id};
  DeviceSample sample;

  // Takes until a sample came; what happened meanwhile is in `seen`.
  Presence seen;
  bool take() {
    seen = {};
    return within_two_seconds([this] {
      const bool taken = port.take(monotonic_ns(), sample);
      seen.connected = port.presence().connected;
      seen.new_client |= port.presence().new_client;
      seen.conflict |= port.presence().conflict;
      return taken;
    });
  }
  void connect(Client& client) {
    ASSERT_TRUE(
        within_two_seconds([&] { return client.writer.matched() > 0 && client.reader.matched() > 0; }));
  }
};

TEST_F(Dds, StateArrivesWholeAndTheForceEchoesIt) {
  Client client(domain);
  connect(client);
  client.state.number = 41;
  client.state.client_time_ns = 123456789;
  client.state.buttons = pedal_aspiration;
  const double position[3] = {0.1, -0.2, 0.3}, orientation[4] = {0.5, -0.5, 0.5, 0.5};
  std::copy(position, position + 3, client.state.position);
  std::copy(orientation, orientation + 4, client.state.orientation);
  const std::int64_t before = monotonic_ns();
  client.send();
  ASSERT_TRUE(take());
  EXPECT_TRUE(seen.new_client);
  EXPECT_TRUE(seen.connected);
  EXPECT_FALSE(seen.conflict);
  EXPECT_EQ(sample.sequence, 42u);
  EXPECT_EQ(sample.client_time_ns, 123456789);
  EXPECT_EQ(sample.pose.p, Vec3(0.1, -0.2, 0.3));
  EXPECT_EQ(sample.pose.q.coeffs(), Eigen::Vector4d(0.5, -0.5, 0.5, 0.5));
  EXPECT_EQ(sample.buttons, pedal_aspiration);
  EXPECT_TRUE(sample.enable);
  EXPECT_GE(sample.received_ns, before - ms);
  EXPECT_LE(sample.received_ns, monotonic_ns());

  ForceSample force;
  force.sequence = 9;
  force.echo_sequence = sample.sequence;
  force.echo_client_time_ns = sample.client_time_ns;
  force.force = Vec3(1, 2, -3);
  force.status = status_ramping_up;
  force.state_age_ns = 250'000;
  force.penetration = 12e-6;
  force.contacts = 70'000;
  force.energy = -2.5e-6;
  port.write(force);
  hapticd_msg_ForceCommand got{};
  ASSERT_TRUE(within_two_seconds([&] {
    const auto keep = [&](const hapticd_msg_ForceCommand& m, const dds_sample_info_t&) { got = m; };
    return client.reader.take_each(keep) > 0;
  }));
  EXPECT_EQ(got.device_id, device_id);
  EXPECT_EQ(got.number, 9u);
  EXPECT_EQ(got.echo_number, 42u);
  EXPECT_EQ(got.echo_client_time_ns, 123456789);
  EXPECT_EQ(got.force[2], -3);
  EXPECT_EQ(got.status, status_ramping_up);
  EXPECT_FLOAT_EQ(got.state_age_us, 250);
  EXPECT_FLOAT_EQ(got.penetration_um, 12);
  EXPECT_EQ(got.contacts, 65535);  // does not wrap
  EXPECT_FLOAT_EQ(got.energy, -2.5e-6f);
}

TEST_F(Dds, TheNewestOfSeveralStatesIsTaken) {
  Client client(domain);
  connect(client);
  for (int i = 0; i < 5; ++i) client.send();
  ASSERT_TRUE(within_two_seconds([&] { return take() && sample.sequence == 5; }));
}

// With exclusive ownership this depends on which writer has the lower GUID: hence several rounds.
TEST_F(Dds, SecondWriterIsAConflictAndTheFirstKeepsTheDevice) {
  Client first(domain);
  connect(first);
  first.send();
  ASSERT_TRUE(take());
  for (int round = 0; round < 6; ++round) {
    auto second = std::make_unique<Client>(domain);
    second->state.number = 1'000'000;
    connect(*second);
    int conflicts = 0;
    for (int i = 0; i < 10; ++i) {
      second->send();
      first.send();
      second->send();
      ASSERT_TRUE(take());
      EXPECT_EQ(sample.sequence, first.state.number);
      EXPECT_FALSE(seen.new_client);
      conflicts += seen.conflict;
    }
    EXPECT_GT(conflicts, 0);
    second.reset();  // disposes the instance they share: the first must not feel that either
    for (int i = 0; i < 20; ++i) {
      first.send();
      ASSERT_TRUE(take());
      EXPECT_EQ(sample.sequence, first.state.number);
      EXPECT_TRUE(seen.connected);
      EXPECT_FALSE(seen.new_client);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
}

TEST_F(Dds, ClientThatLeavesIsGoneAndTheNextOneIsNew) {
  auto first = std::make_unique<Client>(domain);
  connect(*first);
  first->send();
  ASSERT_TRUE(take());
  EXPECT_TRUE(port.presence().connected);
  first.reset();
  EXPECT_TRUE(within_two_seconds([&] {
    port.take(monotonic_ns(), sample);
    return !port.presence().connected;
  }));
  Client second(domain);
  connect(second);
  second.send();
  ASSERT_TRUE(take());
  EXPECT_TRUE(seen.new_client);
  EXPECT_TRUE(seen.connected);
}

TEST_F(Dds, ClientThatDisposesItsDeviceIsGone) {
  Client client(domain);
  connect(client);
  client.send();
  ASSERT_TRUE(take());
  ASSERT_EQ(client.writer.dispose(client.state), DDS_RETCODE_OK);
  EXPECT_TRUE(within_two_seconds([&] {
    port.take(monotonic_ns(), sample);
    return !port.presence().connected;
  }));
  client.send();  // the same writer: back, but not a new client that would be armed at once
  ASSERT_TRUE(take());
  EXPECT_FALSE(seen.new_client);
}

TEST_F(Dds, DisposedRightBehindItsLastStateIsGoneToo) {
  Client client(domain);
  connect(client);
  client.send();
  ASSERT_TRUE(take());
  client.send();
  ASSERT_EQ(client.writer.dispose(client.state), DDS_RETCODE_OK);
  EXPECT_TRUE(within_two_seconds([&] {
    EXPECT_FALSE(port.take(monotonic_ns(), sample) && !port.presence().connected);
    return !port.presence().connected;
  }));
}

TEST_F(Dds, FirstWriterLeavingAmongOthersIsSeenThoughTheInstanceStaysAlive) {
  auto first = std::make_unique<Client>(domain);
  Client second(domain);
  connect(*first);
  connect(second);
  first->send();
  ASSERT_TRUE(take());
  first.reset();
  EXPECT_TRUE(within_two_seconds([&] {
    port.take(monotonic_ns(), sample);
    return !port.presence().connected;
  }));
  second.send();
  ASSERT_TRUE(take());
  EXPECT_TRUE(seen.new_client);
}

// Its dispose stands on the instance until the client's next state, when it may be matched no more.
TEST_F(Dds, AStrangersDisposeAsItLeavesTakesNothingFromTheClient) {
  Client client(domain);
  auto stranger = std::make_unique<Client>(domain);
  connect(client);
  connect(*stranger);
  client.send();
  ASSERT_TRUE(take());
  client.send();
  ASSERT_EQ(stranger->writer.dispose(stranger->state), DDS_RETCODE_OK);
  stranger.reset();
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  ASSERT_TRUE(take());
  EXPECT_TRUE(port.presence().connected);
  client.send();
  ASSERT_TRUE(take());
  EXPECT_FALSE(seen.new_client);
}

TEST_F(Dds, SilentClientLosesTheDeviceAfter500ms) {
  Client first(domain), second(domain);
  connect(first);
  connect(second);
  first.send();
  ASSERT_TRUE(take());
  const std::int64_t heard = monotonic_ns();
  second.send();
  ASSERT_TRUE(within_two_seconds([&] {
    EXPECT_FALSE(port.take(heard + 50 * ms, sample));
    return port.presence().conflict;
  }));
  std::this_thread::sleep_for(std::chrono::milliseconds(520));  // strangers are refused as they arrive
  second.send();
  ASSERT_TRUE(within_two_seconds([&] { return port.take(heard + 600 * ms, sample); }));
  EXPECT_TRUE(port.presence().new_client);
  EXPECT_EQ(sample.sequence, 2u);
}

TEST_F(Dds, OtherDevicesAreNotHeard) {
  Client other(domain, device_id + 1), own(domain);
  connect(other);
  connect(own);
  other.send();
  other.send();
  own.send();
  ASSERT_TRUE(take());
  EXPECT_EQ(sample.sequence, 1u);
  EXPECT_FALSE(seen.conflict);
}

TEST_F(Dds, NotANumberCrossesTheWireAndIsRefused) {
  Client client(domain);
  connect(client);
  client.state.position[1] = std::nan("");
  client.send();
  ASSERT_TRUE(take());
  DeviceSettings device;
  device.max_speed = 1;
  WatchdogState state;
  WatchdogInput input;
  input.now_ns = sample.received_ns;
  input.presence = seen;
  input.taken = true;
  input.sample = sample;
  input.has_problem = true;
  input.problem_published_ns = input.now_ns;
  const Verdict verdict = watch({}, device, input, state);
  EXPECT_EQ(verdict.refusal, Refusal::not_finite);
  EXPECT_EQ(verdict.render, Render::zero);
}

TEST_F(Dds, TakeAndWriteAllocateNothingOnceWarm) {
  if (!MallocGuard::available()) GTEST_SKIP() << "malloc belongs to the sanitizer";
  Client client(domain);
  connect(client);
  const auto exchange = [&](int rounds) {
    long allocations = 0;
    for (int i = 0; i < rounds; ++i) {
      client.send();
      std::this_thread::sleep_for(std::chrono::microseconds(300));
      const MallocGuard guard;
      port.take(monotonic_ns(), sample);
      port.write({});
      allocations += guard.allocations();
    }
    return allocations;
  };
  exchange(200);
  EXPECT_EQ(exchange(500), 0);
}

TEST_F(Dds, DomainThatExistsOrIsBadlyConfiguredIsNamedInTheError) {
  try {
    Domain again(domain.id(), read_dds_profile("loopback"));
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("domain " + std::to_string(domain.id())), std::string::npos);
  }
  EXPECT_THROW(Domain(domain.id() + 1, "<CycloneDDS><Domain><Nonsense/></Domain></CycloneDDS>"),
               std::runtime_error);
  EXPECT_THROW(read_dds_profile("no-such-profile"), std::exception);
}

TEST_F(Dds, RealtimeProfileEitherWorksOrSaysWhyNotAndTheDefaultAlwaysWorks) {
  const std::uint32_t id = (domain.id() + 50) % 200;
  if (realtime_allowed()) {
    EXPECT_NO_THROW(Domain(id, read_dds_profile("loopback_realtime")));
  } else {
    EXPECT_THROW(Domain(id, read_dds_profile("loopback_realtime")), std::runtime_error);
  }
  EXPECT_NO_THROW(Domain(id, default_dds_profile()));
}

}  // namespace
}  // namespace hapticd
