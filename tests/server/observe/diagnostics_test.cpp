#include "server/observe/diagnostics.h"

#include <unistd.h>

#include <chrono>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>

#include <gtest/gtest.h>

#include "server/observe/operation_message.h"

namespace hapticd {
namespace {

bool within_two_seconds(const std::function<bool()>& done) {
  for (int i = 0; i < 400; ++i) {
    if (done()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return false;
}

Scene tetrahedron() {
  Scene scene;
  scene.name = "one tetrahedron";
  scene.first().device.id = 3;
  SceneBody body;
  body.name = "tissue";
  body.mesh.nodes = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  body.mesh.tets = {{0, 1, 2, 3}};
  scene.bodies.push_back(body);
  return scene;
}

// An event is of the newest; a body's loss is a share.
TEST(Diagnostics, AnOperationsMessageHasItsMeasures) {
  OperationMeasures m{.time = 12.5,
                      .hands = {{0.3, 4, 2, 1, 0.5, 2500}},
                      .bodies = {},
                      .events = {{3.5, "crack", "lens", 2}}};
  m.bodies.push_back({.name = "lens", .deformable = true, .volume = 2e-7, .volume_gone = 5e-8, .pieces = 4});
  std::vector<hapticd_msg_HandOperation> hands;
  std::vector<hapticd_msg_BodyOperation> bodies;
  const std::string scene = "phaco";
  const hapticd_msg_SceneOperation out = operation_message(3, scene, m, 17, hands, bodies);
  EXPECT_EQ(out.device_id, 3u);
  EXPECT_STREQ(out.scene, "phaco");
  ASSERT_EQ(out.hands._length, 1u);
  EXPECT_FLOAT_EQ(out.hands._buffer[0].path, 0.3f);
  EXPECT_FLOAT_EQ(out.hands._buffer[0].force_most, 0.5f);
  EXPECT_FLOAT_EQ(out.hands._buffer[0].vacuum, 2500);
  ASSERT_EQ(out.bodies._length, 1u);
  EXPECT_STREQ(out.bodies._buffer[0].name, "lens");
  EXPECT_FLOAT_EQ(out.bodies._buffer[0].volume_gone, 0.25f);
  EXPECT_EQ(out.bodies._buffer[0].pieces, 4u);
  EXPECT_EQ(out.events, 17u);
  EXPECT_STREQ(out.event, "crack");
  EXPECT_EQ(out.event_time, 3.5);
}

TEST(Diagnostics, BitsArePackedLeastSignificantFirst) {
  std::vector<std::uint8_t> bits;
  pack_bits({1, 0, 0, 1, 1, 1, 1, 1, 0, 1}, bits);
  EXPECT_EQ(bits, (std::vector<std::uint8_t>{0b11111001, 0b10}));
}

TEST(Diagnostics, SummaryIsInTheUnitsItsNamesSay) {
  LoopStatistics s;
  for (int i = 0; i < 900; ++i) s.wake.record(50'000);
  s.problem_age.record(20'000'000);
  s.run = 990;
  s.missed = 10;
  s.answered = 980;
  s.deadline_misses = 2;
  s.force_peak = 1.5;
  s.penetration_max = 12e-6;
  s.first_ns = 1'000'000'000;
  s.next_ns = 2'000'000'000;
  const nlohmann::json j = loop_summary(s);
  EXPECT_NEAR(j["haptic_rate_hz"].get<double>(), 990, 1e-9);
  EXPECT_EQ(j["haptic_deadline_misses"], 2);
  EXPECT_EQ(j["slots_scheduled"], 1000);
  EXPECT_EQ(j["slots_sent"], 990);
  EXPECT_EQ(j["slots_answered"], 980);
  EXPECT_NEAR(j["wake_us"]["p50"].get<double>(), 50, 0.5);
  EXPECT_NEAR(j["problem_age_ms"]["max"].get<double>(), 20, 1e-9);
  EXPECT_NEAR(j["penetration_max_um"].get<double>(), 12, 1e-9);
  EXPECT_EQ(j["force_peak_n"], 1.5);
}

TEST(Diagnostics, LateReaderGetsTheSceneAndTheRecordingHasEveryTick) {
  const Domain domain((static_cast<std::uint32_t>(getpid()) + 100) % 200, read_dds_profile("loopback"));
  const Participant daemon(domain);
  const Scene scene = tetrahedron();
  LoopStatistics statistics;
  Channel<SceneSnapshot> snapshots;
  SpscQueue<ForceRecord> history(64);
  const std::filesystem::path file = testing::TempDir() + "forces_" + std::to_string(getpid()) + ".csv";
  {
    Diagnostics diagnostics(daemon, scene, statistics, snapshots, history, file);
    diagnostics.start();
    SceneSnapshot& snapshot = snapshots.back();
    snapshot.step = 5;
    snapshot.bodies = {{{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1.25f}, {1}}};
    snapshot.elements_removed = 17;
    snapshots.publish();
    for (std::uint64_t i = 1; i <= 10; ++i) {
      ForceRecord record;
      record.time_ns = 5'000'000'000 + static_cast<std::int64_t>(i) * 1'000'000;
      record.force.sequence = i;
      record.force.force = Vec3(0, 0, 0.5);
      history.push(record);
    }

    const Participant client(domain);
    Reader<hapticd_msg_SceneGeometry> geometry(client);
    Reader<hapticd_msg_SceneUpdate> update(client);
    Reader<hapticd_msg_ServerStatus> status(client);
    std::string name;
    std::size_t nodes = 0;
    EXPECT_TRUE(within_two_seconds([&] {
      geometry.take_each([&](const hapticd_msg_SceneGeometry& m, const dds_sample_info_t&) {
        name = m.name;
        nodes = m.nodes._length;
      });
      return !name.empty();
    }));
    EXPECT_EQ(name, "tissue");
    EXPECT_EQ(nodes, 12u);
    float z = 0;
    EXPECT_TRUE(within_two_seconds([&] {
      update.take_each(
          [&](const hapticd_msg_SceneUpdate& m, const dds_sample_info_t&) { z = m.nodes._buffer[11]; });
      return z > 0;
    }));
    EXPECT_EQ(z, 1.25f);
    std::uint32_t removed = 0;
    EXPECT_TRUE(within_two_seconds([&] {
      status.take_each([&](const hapticd_msg_ServerStatus& m, const dds_sample_info_t&) {
        EXPECT_EQ(m.device_id, 3u);
        EXPECT_STREQ(m.scene, "one tetrahedron");
        removed = m.elements_removed;
      });
      return removed > 0;
    }));
    EXPECT_EQ(removed, 17u);
    diagnostics.stop();
    EXPECT_FALSE(diagnostics.recording_failed());
  }
  std::ifstream in(file);
  std::string header, line, last;
  std::getline(in, header);
  EXPECT_TRUE(header.starts_with("t,tick,echo,px,"));
  int lines = 0;
  while (std::getline(in, line)) {
    ++lines;
    last = line;
    EXPECT_EQ(std::count(line.begin(), line.end(), ','), std::count(header.begin(), header.end(), ','));
  }
  EXPECT_EQ(lines, 10);
  EXPECT_TRUE(last.starts_with("0.009000,10,"));
  std::filesystem::remove(file);
}

// Two instruments: a late reader knows whose device moves which, and which of them presses what.
TEST(Diagnostics, ALateReaderKnowsTheInstrumentsTheirDevicesAndWhoPresses) {
  const Domain domain((static_cast<std::uint32_t>(getpid()) + 100) % 200, read_dds_profile("loopback"));
  const Participant daemon(domain);
  Scene scene = tetrahedron();
  scene.instruments.resize(2);
  scene.instruments[0].name = "left";
  scene.instruments[1].name = "right";
  scene.instruments[1].device.id = 5;
  scene.instruments[1].device.max_force = 7;
  scene.instruments[1].device_name = "touch";
  LoopStatistics statistics;
  Channel<SceneSnapshot> snapshots, of_right;
  SpscQueue<ForceRecord> history(64), history_of_right(64);
  Diagnostics left(daemon, scene, statistics, snapshots, history, std::nullopt, DiagnosticsScope{3, true});
  Diagnostics right(daemon, scene, statistics, of_right, history_of_right, std::nullopt,
                    DiagnosticsScope{5, false});
  left.start();
  right.start();
  SceneSnapshot& snapshot = snapshots.back();
  snapshot.step = 5;
  snapshot.bodies = {{{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}, {1}}};
  snapshot.instruments.resize(2);
  snapshot.contacts.resize(14);
  snapshot.pressing = {0, 255, 1, 0};
  snapshots.publish();

  const Participant client(domain);
  Reader<hapticd_msg_SceneInstrument> instruments(client);
  Reader<hapticd_msg_SceneUpdate> updates(client);
  Reader<hapticd_msg_ServerHealth> health(client);
  std::map<std::uint32_t, std::string> devices;
  EXPECT_TRUE(within_two_seconds([&] {
    instruments.take_each([&](const hapticd_msg_SceneInstrument& m, const dds_sample_info_t&) {
      EXPECT_EQ(m.instruments, 2u);
      devices[m.device_id] = m.name;
    });
    return devices.size() == 2;
  }));
  EXPECT_EQ(devices[3], "left");
  EXPECT_EQ(devices[5], "right");
  std::vector<int> pressing;
  EXPECT_TRUE(within_two_seconds([&] {
    updates.take_each([&](const hapticd_msg_SceneUpdate& m, const dds_sample_info_t&) {
      EXPECT_EQ(m.instruments._length, 14u);
      pressing.assign(m.pressing._buffer, m.pressing._buffer + m.pressing._length);
    });
    return !pressing.empty();
  }));
  EXPECT_EQ(pressing, (std::vector<int>{0, 255, 1, 0}));
  // Each device's health is its own, with its own limits.
  std::map<std::uint32_t, float> limits;
  EXPECT_TRUE(within_two_seconds([&] {
    health.take_each([&](const hapticd_msg_ServerHealth& m, const dds_sample_info_t&) {
      limits[m.device_id] = m.max_force;
      if (m.device_id == 5) {
        EXPECT_STREQ(m.device, "touch");
      }
    });
    return limits.size() == 2;
  }));
  EXPECT_EQ(limits[5], 7);
}

TEST(Diagnostics, RecordingThatCannotBeWrittenIsNamed) {
  try {
    ForceRecordWriter writer("/no/such/folder/forces.csv");
    FAIL();
  } catch (const std::runtime_error& e) {
    EXPECT_NE(std::string(e.what()).find("/no/such/folder/forces.csv"), std::string::npos);
  }
}

}  // namespace
}  // namespace hapticd
