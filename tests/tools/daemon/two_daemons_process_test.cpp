// Two daemons as processes for one device, and a client that presses: none serves it, both say so, and the
// client feels nothing beyond its own scene's force on the way to zero.
#include <cmath>
#include <fstream>
#include <map>

#include <gtest/gtest.h>

#include "haptic/clock.h"
#include "server/files/paths.h"
#include "tests/support/process.h"
#include "tests/tools/fake_daemon.h"
#include "tests/tools/run_command.h"
#include "tests/tools/scripted_client.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;
using Force = hapticd_msg_ForceCommand;

constexpr double touch_step = 0.2, touch_most = 3.3;  // N a tick, N
constexpr std::uint32_t both = status_rival | status_latched | status_disarmed;

bool has(const Force& f, std::uint32_t bits) { return (f.status & bits) == bits; }
double magnitude(const Force& f) { return ScriptedClient::magnitude(f); }
bool felt(const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }

// Everything that anybody writes, by writer: whom no client hears is heard here.
class Everybody {
 public:
  struct Heard {
    std::int64_t at_ns = 0;
    Force force;
  };
  explicit Everybody(const Participant& participant)
      : topic_(make_topic<Force>(participant)), reader_(made(participant, topic_.handle())) {
    const std::unique_ptr<dds_listener_t, decltype(&dds_delete_listener)> listener(dds_create_listener(this),
                                                                                   &dds_delete_listener);
    dds_lset_data_available(listener.get(),
                            [](dds_entity_t, void* self) { static_cast<Everybody*>(self)->receive(); });
    require(dds_set_listener(reader_.handle(), listener.get()), "a listener");
  }
  ~Everybody() { dds_set_listener(reader_.handle(), nullptr); }
  // Of each writer, in the order of their first forces.
  std::vector<std::vector<Heard>> heard() const {
    const std::lock_guard lock(mutex_);
    return heard_;
  }

 private:
  static DdsEntity made(const Participant& participant, dds_entity_t topic) {
    Qos qos = realtime_qos(64);
    return DdsEntity(require(dds_create_reader(participant.handle(), topic, qos.get(), nullptr), "a reader"));
  }
  void receive() noexcept {
    std::array<Force, 64> taken;
    std::array<dds_sample_info_t, 64> infos;
    std::array<void*, 64> buffer;
    for (std::size_t i = 0; i < buffer.size(); ++i) buffer[i] = &taken[i];
    const int n = dds_take(reader_.handle(), buffer.data(), infos.data(), buffer.size(), buffer.size());
    const std::int64_t now = monotonic_ns();
    const std::lock_guard lock(mutex_);
    for (std::size_t i = 0; static_cast<int>(i) < n; ++i) {
      if (!infos[i].valid_data) continue;
      const auto [at, is_new] = index_.try_emplace(infos[i].publication_handle, heard_.size());
      if (is_new) heard_.emplace_back();
      heard_[at->second].push_back({now, taken[i]});
    }
  }

  mutable std::mutex mutex_;
  std::map<dds_instance_handle_t, std::size_t> index_;
  std::vector<std::vector<Heard>> heard_;
  DdsEntity topic_, reader_;
};

class TwoDaemons : public testing::Test {
 protected:
  TwoDaemons()
      : id_(test_domain()),
        domain_(id_, default_dds_profile()),
        participant_(domain_),
        watcher_(domain_),
        everybody_(watcher_),
        statuses_(watcher_) {
    for (const double scale : {1.0, 10.0}) {
      const fs::path folder = scratch_.file(scale > 1 ? "strong" : "plain");
      fs::copy(SOURCE_DIR "/config/scenes/cube", folder);
      std::string text = read_bytes(folder / "cube.yaml");
      const std::string key = "force_scale: 1}";
      text.replace(text.find(key), key.size(), "force_scale: " + std::to_string(scale) + "}");
      std::ofstream(folder / "cube.yaml") << text;
    }
  }
  std::unique_ptr<ChildProcess> start(const std::string& scene, const std::vector<std::string>& more = {}) {
    std::vector<std::string> command{BIN_DIR "/hapticd",
                                     scratch_.file(scene) + "/cube.yaml",
                                     "--domain",
                                     std::to_string(id_),
                                     "--log",
                                     "json"};
    command.insert(command.end(), more.begin(), more.end());
    return std::make_unique<ChildProcess>(command, log_file(scene));
  }
  std::string log_file(const std::string& scene) const { return scratch_.file("log_" + scene); }
  std::string log(const std::string& scene) const { return read_bytes(log_file(scene)); }
  static void pause(int milliseconds) {
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
  }
  bool wait_for_writers(std::size_t writers) {
    for (int i = 0; i < 20'000 && everybody_.heard().size() < writers; ++i) pause(1);
    return everybody_.heard().size() >= writers;
  }
  // Presses 1.5 mm into the cube until the force stands.
  bool press(ScriptedClient& client) {
    pause(200);
    client.enable(true);
    client.move_to(0.0215, 500);
    return client.await(20'000, felt);
  }

  ScratchDirectory scratch_;
  std::uint32_t id_;
  Domain domain_;
  Participant participant_, watcher_;
  Everybody everybody_;
  Reader<hapticd_msg_ServerStatus> statuses_;
};

class TwoDaemonsInOrder : public TwoDaemons, public testing::WithParamInterface<bool> {};

TEST_P(TwoDaemonsInOrder, TheSecondEndsTheServiceAndNobodyFeelsMoreThanHisScene) {
  const std::string first = GetParam() ? "strong" : "plain", second = GetParam() ? "plain" : "strong";
  auto serving = start(first);
  ScriptedClient client(participant_);
  ASSERT_TRUE(press(client)) << log(first);
  pause(500);
  double steady = 0;
  for (const Force& f : client.forces()) steady = std::max(steady, magnitude(f));
  const std::size_t from = client.count();
  auto intruder = start(second);
  ASSERT_TRUE(wait_for_writers(2)) << log(second);
  pause(1500);

  // One says conflict within 100 ms: here the one that served.
  const auto writers = everybody_.heard();
  const std::int64_t came = writers[1].front().at_ns;
  std::int64_t said = 0;
  for (const auto& h : writers[0])
    if (said == 0 && has(h.force, status_rival)) said = h.at_ns;
  ASSERT_NE(said, 0);
  EXPECT_LT(1e-6 * static_cast<double>(said - came), 100);

  // The second never gave a force, the client felt the first's, let down at the device's slew limit.
  for (const auto& h : writers[1]) EXPECT_EQ(magnitude(h.force), 0);
  const std::vector<Force> forces = client.forces(from);
  double before = steady;
  for (std::size_t i = 0; i < forces.size(); ++i) {
    EXPECT_LE(magnitude(forces[i]), std::min(touch_most, 1.02 * steady));
    if (i > 0) {
      const auto ticks = static_cast<double>(forces[i].number - forces[i - 1].number);
      EXPECT_LE(std::abs(magnitude(forces[i]) - before), 1.001 * touch_step * std::max(1.0, ticks));
    }
    before = magnitude(forces[i]);
  }
  EXPECT_EQ(magnitude(forces.back()), 0);
  EXPECT_TRUE(has(forces.back(), both)) << forces.back().status;
  EXPECT_TRUE(has(writers[1].back().force, both)) << writers[1].back().force.status;
  EXPECT_GT(client.strange_forces(), 0u);  // the client knows, too
  for (const std::string& scene : {first, second})
    EXPECT_NE(log(scene).find("\"event\":\"second_daemon\""), std::string::npos) << log(scene);
  int said_in_status = 0;
  statuses_.take_each([&](const hapticd_msg_ServerStatus& m, const dds_sample_info_t&) {
    said_in_status += (m.status & status_rival) != 0;
  });
  EXPECT_GT(said_in_status, 0);

  // Latched: with the second gone nothing comes back by itself, and after letting go everything does.
  intruder->signal(SIGKILL);
  intruder->wait(5000);
  const std::size_t gone = client.count();
  pause(1500);
  for (const Force& f : client.forces(gone)) EXPECT_EQ(magnitude(f), 0);
  client.enable(false);
  pause(100);
  client.enable(true);
  EXPECT_TRUE(client.await(20'000, felt)) << log(first);
}
INSTANTIATE_TEST_SUITE_P(Orders, TwoDaemonsInOrder, testing::Bool(), [](const auto& test) {
  return std::string(test.param ? "StrongServesFirst" : "PlainServesFirst");
});

TEST_F(TwoDaemons, StartedAtOnceNeitherArms) {
  ScriptedClient client(participant_);
  client.enable(true);
  auto plain = start("plain"), strong = start("strong");
  ASSERT_TRUE(wait_for_writers(2));
  client.move_to(0.0215, 500);
  pause(2000);
  for (const auto& writer : everybody_.heard()) {
    for (const auto& h : writer) {
      EXPECT_EQ(magnitude(h.force), 0);
      EXPECT_TRUE(has(h.force, status_disarmed));
    }
    EXPECT_TRUE(has(writer.back().force, both));
  }
}

TEST_F(TwoDaemons, AnotherDeviceIdIsNoConflict) {
  std::ofstream(scratch_.file("second.yaml"))
      << read_bytes(SOURCE_DIR "/config/devices/touch.yaml") << "id: 1\n";
  auto first = start("plain"), second = start("strong", {"--device", scratch_.file("second.yaml")});
  ScriptedClient client(participant_), other(watcher_, 1);
  ASSERT_TRUE(wait_for_writers(2));
  ASSERT_TRUE(press(client)) << log("plain");
  ASSERT_TRUE(press(other)) << log("strong");
  for (const auto& writer : everybody_.heard())
    for (const auto& h : writer) EXPECT_FALSE(has(h.force, status_rival));
}

// Who is no daemon, and writes one force for the device; one for another device is nothing.
TEST_F(TwoDaemons, SomebodyWhoWritesOneForceIsEnough) {
  auto daemon = start("plain");
  ScriptedClient client(participant_);
  ASSERT_TRUE(press(client)) << log("plain");
  const Participant stranger(domain_);
  Writer<Force> writer(stranger);
  for (int i = 0; i < 5000 && writer.matched() < 3; ++i) pause(1);  // client, watcher, daemon
  ASSERT_GE(writer.matched(), 3);
  Force force{};
  force.device_id = 7;
  std::size_t from = client.count();
  writer.write(force);
  pause(300);
  for (const Force& f : client.forces(from)) EXPECT_FALSE(has(f, status_rival));
  force.device_id = 0;
  force.force[2] = 1e9;
  from = client.count();
  writer.write(force);
  EXPECT_TRUE(client.await(
      2000, [](const Force& f) { return has(f, both) && magnitude(f) == 0; }, from));
  for (const Force& f : client.forces(from)) EXPECT_LT(magnitude(f), touch_most);
  EXPECT_EQ(client.strange_forces(), 1u);
}

}  // namespace
}  // namespace hapticd
