// A recording: what goes in comes out, by our reader; and what a broken or foreign one is told.
#include <sqlite3.h>
#include <sys/resource.h>

#include <csignal>
#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>

#include "server/files/input_error.h"
#include "server/files/paths.h"
#include "server/observe/bag_recorder.h"
#include "server/record/bag_reader.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

class Bag : public testing::Test {
 protected:
  Bag() : directory_(fs::path(testing::TempDir()) / ("bag" + std::to_string(getpid()))) {
    fs::remove_all(directory_);
  }
  ~Bag() override { fs::remove_all(directory_); }

  // At 1 kHz, 2 µm a tick along x, turning about z, the pedal down from tick 5 on.
  static ForceRecord tick(int i) {
    ForceRecord r;
    r.time_ns = 1'000'000'000 + std::int64_t{1'000'000} * i;
    r.force.answers = true;
    r.force.force = Vec3(1e-3 * i, 1.0 / 3, -2);
    r.force.torque = Vec3(0, 0.1, 0);
    r.device.p = Vec3(2e-6 * i, 0.1, -0.2);
    r.device.q = Quat(Eigen::AngleAxisd(1e-3 * i, Vec3::UnitZ()));
    r.instrument.present = true;
    r.instrument.received_ns = r.time_ns - 400'000;
    r.instrument.buttons = i >= 5 ? 1 : 0;
    return r;
  }
  fs::path database() const { return directory_ / (directory_.filename().string() + "_0.db3"); }
  void edit(const std::string& sql) const {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(database().c_str(), &db), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK) << sqlite3_errmsg(db);
    sqlite3_close(db);
  }
  void record(int ticks) const {
    DeviceBag bag(directory_, 3, 0);
    for (int i = 0; i < ticks; ++i) bag.note(tick(i));
  }
  std::string fault(const std::string& topic = "") const {
    try {
      read_bag(directory_, topic, LengthUnit::metre);
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  }

  fs::path directory_;
};

TEST_F(Bag, AMotionComesBackBitForBit) {
  record(20);
  const Trajectory motion = read_bag(directory_, "", LengthUnit::metre);
  ASSERT_EQ(motion.samples.size(), 20u);
  for (int i = 0; i < 20; ++i) {
    const TrajectorySample& s = motion.samples[static_cast<std::size_t>(i)];
    EXPECT_EQ(s.pose.p, tick(i).device.p);
    EXPECT_LT(s.pose.q.angularDistance(tick(i).device.q), 1e-15);
    EXPECT_NEAR(s.t, 1e-3 * i, 1e-12);
    EXPECT_EQ(s.buttons, i >= 5 ? 1u : 0u);
  }
  const Trajectory by_file = read_bag(database(), "/haptic/3/pose", LengthUnit::millimetre);
  EXPECT_EQ(by_file.samples[7].pose.p, 1e-3 * tick(7).device.p);
  const std::string bytes = read_bytes(database());
  const std::span data(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
  EXPECT_EQ(parse_bag(data, "a.db3", "", LengthUnit::metre).samples[19].pose.p, tick(19).device.p);
}

TEST_F(Bag, ThePlainDatabaseHasASchemaThatRos2Knows) {
  record(3);
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open_v2(database().c_str(), &db, SQLITE_OPEN_READONLY, nullptr), SQLITE_OK);
  std::string out;
  const auto row = [](void* text, int n, char** values, char**) {
    for (int i = 0; i < n; ++i) *static_cast<std::string*>(text) += std::string(values[i]) + "|";
    return 0;
  };
  sqlite3_exec(db,
               "SELECT * FROM schema; SELECT id, name, type, serialization_format FROM topics;"
               "SELECT topic_id, timestamp, count(*) FROM messages GROUP BY topic_id",
               row, &out, nullptr);
  sqlite3_close(db);
  EXPECT_EQ(
      out,
      "3|humble|1|/haptic/3/pose|geometry_msgs/msg/PoseStamped|cdr|2|/haptic/3/wrench|geometry_msgs/msg/"
      "WrenchStamped|cdr|3|/haptic/3/buttons|sensor_msgs/msg/Joy|cdr|4|/diagnostics|diagnostic_msgs/msg/"
      "DiagnosticArray|cdr|1|1000000000|3|2|1000000000|3|3|1000000000|1|");
  EXPECT_FALSE(fs::exists(database().string() + "-journal"));
}

TEST_F(Bag, ATickWithoutANewStateHasAWrenchAlone) {
  {
    DeviceBag bag(directory_, 3, 0);
    ForceRecord r = tick(0);
    r.force.answers = false;
    bag.note(r);
    bag.note(tick(1));
    bag.close();
    EXPECT_EQ(bag.bag().kept(), 4u);  // wrench; pose, buttons, wrench
    EXPECT_EQ(bag.bag().lost(), 0u);
  }
}

TEST_F(Bag, TheRecorderWritesAllThatItWasGiven) {
  BagRecorder recorder(directory_, 3);
  for (int i = 0; i < 3000; ++i) recorder.push(tick(i));
  recorder.push(Diagnostic{0, Diagnostic::ok, "hapticd", "all well", {{"a", "b"}}});
  recorder.stop();
  EXPECT_EQ(recorder.kept(), 6003u);
  EXPECT_EQ(recorder.lost(), 0u);
  EXPECT_FALSE(recorder.failed());
  EXPECT_EQ(read_bag(directory_, "", LengthUnit::metre).samples.size(), 3000u);
}

// A full disk, as the database sees one: what was committed stays, the rest is counted, nothing throws.
TEST_F(Bag, AFullDiskEndsTheRecordingAndCountsWhatIsLost) {
  struct rlimit before {};
  getrlimit(RLIMIT_FSIZE, &before);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  std::uint64_t kept = 0;
  {
    DeviceBag bag(directory_, 3, 0);
    const struct rlimit small { 200'000, before.rlim_max };
    setrlimit(RLIMIT_FSIZE, &small);
    for (int i = 0; i < 3000; ++i) {
      bag.note(tick(i));
      if (i % 200 == 199) bag.commit();
    }
    bag.close();
    setrlimit(RLIMIT_FSIZE, &before);
    kept = bag.bag().kept();
    EXPECT_TRUE(bag.bag().failed());
    EXPECT_GT(kept, 400u);
    EXPECT_EQ(kept + bag.bag().lost(), 6002u);
  }
  std::signal(SIGXFSZ, handler);
  const auto poses = read_bag(directory_, "", LengthUnit::metre).samples.size();
  EXPECT_EQ(poses, 200 * ((kept - 2) / 400));
  EXPECT_NE(read_bytes(directory_ / "metadata.yaml").find("message_count: " + std::to_string(kept)),
            std::string::npos);
}

TEST_F(Bag, ARecordingIsNotWrittenOver) {
  record(2);
  EXPECT_THROW(record(2), InputError);
  EXPECT_EQ(read_bag(directory_, "", LengthUnit::metre).samples.size(), 2u);
}

TEST_F(Bag, WhatIsNoRecordingIsToldSo) {
  EXPECT_NE(fault().find("no such file"), std::string::npos) << fault();
  fs::create_directories(directory_);
  EXPECT_NE(fault().find("neither metadata.yaml nor a .db3"), std::string::npos) << fault();
  std::ofstream(database()) << "not a database, though it is long enough to be looked at as if it were one";
  EXPECT_NE(fault().find("no rosbag2 recording"), std::string::npos) << fault();
  std::ofstream(directory_ / "metadata.yaml") << "rosbag2_bagfile_information:\n  storage_identifier: mcap\n";
  EXPECT_NE(fault().find("'mcap' is not read"), std::string::npos) << fault();
  std::ofstream(directory_ / "metadata.yaml") << "a: [";
  EXPECT_NE(fault().find("metadata.yaml:"), std::string::npos) << fault();
}

TEST_F(Bag, TopicsAreNamedWhereOneHasToBeChosen) {
  record(4);
  EXPECT_NE(fault("/haptic/3/wrench").find("has geometry_msgs/msg/WrenchStamped"), std::string::npos);
  EXPECT_NE(fault("/tf").find("is not there (with poses: /haptic/3/pose)"), std::string::npos);
  edit("INSERT INTO topics VALUES (9, '/tool', 'geometry_msgs/msg/TransformStamped', 'cdr', '')");
  EXPECT_NE(fault().find("several topics with poses, --topic says which: /haptic/3/pose, /tool"),
            std::string::npos);
  EXPECT_EQ(read_bag(directory_, "/haptic/3/pose", LengthUnit::metre).samples.size(), 4u);
  EXPECT_NE(fault("/tool").find("only 0 messages"), std::string::npos);
  edit("UPDATE topics SET serialization_format = 'json'");
  EXPECT_NE(fault("/haptic/3/pose").find("'json'"), std::string::npos);
}

// A transform is a pose with the child's frame before it.
TEST_F(Bag, TransformsAreReadAsPoses) {
  {
    BagWriter bag(directory_);
    const int topic = bag.add_topic("/tool", "geometry_msgs/msg/TransformStamped");
    for (int i = 0; i < 3; ++i) {
      CdrWriter cdr;
      cdr.put(std::int32_t{5});
      cdr.put(std::uint32_t(1000 * i));
      cdr.text("base");
      cdr.text("tool");
      for (const double v : {0.1 * i, 0.2, 0.3, 0.0, 0.0, 0.0, 1.001}) cdr.put(v);
      bag.write(topic, 7, cdr.bytes());
    }
  }
  const Trajectory motion = read_bag(directory_, "", LengthUnit::metre);
  ASSERT_EQ(motion.samples.size(), 3u);
  EXPECT_EQ(motion.samples[2].pose.p, Vec3(0.2, 0.2, 0.3));
  EXPECT_EQ(motion.samples[2].pose.q.w(), 1);
  EXPECT_NEAR(motion.samples[2].t, 2e-6, 1e-15);
}

// Headers without a clock: the bag's own times serve; without those either, there is no motion.
TEST_F(Bag, TimesThatDoNotRiseAreTakenFromTheBagOrRefused) {
  {
    BagWriter bag(directory_);
    const int topic = bag.add_topic("/p", "geometry_msgs/msg/PoseStamped");
    for (int i = 0; i < 3; ++i) {
      CdrWriter cdr;
      put_pose(cdr, {0, ""}, {});
      bag.write(topic, 2'000'000 * i, cdr.bytes());
    }
  }
  EXPECT_NEAR(read_bag(directory_, "", LengthUnit::metre).samples[2].t, 4e-3, 1e-15);
  edit("UPDATE messages SET timestamp = 7");
  EXPECT_NE(fault().find("the time does not rise"), std::string::npos);
}

TEST_F(Bag, AMessageThatDoesNotDecodeIsNamed) {
  record(4);
  edit("UPDATE messages SET data = x'0001000000' WHERE id = 4");
  EXPECT_NE(fault().find("/haptic/3/pose, message 4: ends early"), std::string::npos) << fault();
  edit("UPDATE messages SET data = NULL WHERE 0; UPDATE messages SET data = 'text' WHERE id = 4");
  EXPECT_NE(fault().find("message 4: is in a representation"), std::string::npos) << fault();
}

// A view could read anything and take for ever.
TEST_F(Bag, AViewIsNotFollowed) {
  record(4);
  edit("ALTER TABLE messages RENAME TO kept; CREATE VIEW messages AS SELECT * FROM kept");
  EXPECT_NE(fault().find("it has no table messages"), std::string::npos) << fault();
}

}  // namespace
}  // namespace hapticd
