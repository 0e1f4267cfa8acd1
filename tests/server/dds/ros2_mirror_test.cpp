// The mirror as a ROS 2 node finds it: type names, hash, representation, and the bytes on the wire against
// CDR packed by hand.
#include "server/dds/ros2_mirror.h"

#include <dds/ddsi/ddsi_serdata.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <thread>

#include <gtest/gtest.h>

#include "haptic/clock.h"
#include "server/observe/diagnostics.h"

namespace hapticd {
namespace {

constexpr std::uint32_t device_id = 3;
constexpr std::int64_t second = 1'000'000'000;

bool within_two_seconds(const std::function<bool()>& done) {
  for (int i = 0; i < 400; ++i) {
    if (done()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return false;
}

// Classic CDR, little endian, as any DDS of any maker reads XCDR1.
class Cdr {
 public:
  explicit Cdr(std::vector<unsigned char> bytes) : bytes_(std::move(bytes)) {}
  // 0x0001: CDR_LE, that is XCDR1.
  int representation() const { return bytes_[0] << 8 | bytes_[1]; }
  template <typename T>
  T get() {
    at_ = (at_ + sizeof(T) - 1) / sizeof(T) * sizeof(T);
    T value{};
    if (4 + at_ + sizeof(T) <= bytes_.size()) std::memcpy(&value, &bytes_[4 + at_], sizeof(T));
    at_ += sizeof(T);
    return value;
  }
  std::string text() {
    const std::uint32_t length = get<std::uint32_t>();  // with the closing zero
    std::string s(reinterpret_cast<const char*>(&bytes_[4 + at_]), length - 1);
    at_ += length;
    return s;
  }
  // 0 to 3 bytes of padding are left at the end.
  bool at_end() const { return bytes_.size() - 4 - at_ < 4; }

 private:
  std::vector<unsigned char> bytes_;
  std::size_t at_ = 0;
};

struct Stamped {
  int representation = 0;
  std::int64_t stamp_ns = 0;
  std::string frame;
  std::vector<double> value;
  bool whole = false;
};

// A plain reader: keyless type of that name, reliable, XCDR1.
class PlainReader {
 public:
  PlainReader(const Participant& participant, const dds_topic_descriptor_t& type, const std::string& name,
              std::size_t values)
      : values_(values) {
    const Qos qos(dds_create_qos(), &dds_delete_qos);
    dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 10);
    const dds_data_representation_id_t xcdr1 = DDS_DATA_REPRESENTATION_XCDR1;
    dds_qset_data_representation(qos.get(), 1, &xcdr1);
    topic_ = DdsEntity(require(dds_create_topic(participant.handle(), &type, name.c_str(), nullptr, nullptr),
                               "topic " + name));
    reader_ = DdsEntity(
        require(dds_create_reader(participant.handle(), topic_.handle(), qos.get(), nullptr), "reader"));
  }
  bool matched() const {
    dds_subscription_matched_status_t s{};
    return dds_get_subscription_matched_status(reader_.handle(), &s) == DDS_RETCODE_OK &&
           s.current_count == 1;
  }
  std::vector<Stamped> take() {
    std::vector<Stamped> out;
    ddsi_serdata* data[16] = {};
    dds_sample_info_t infos[16];
    const int n = dds_takecdr(reader_.handle(), data, 16, infos, DDS_ANY_STATE);
    for (int i = 0; i < n; ++i) {
      std::vector<unsigned char> bytes(ddsi_serdata_size(data[i]));
      ddsi_serdata_to_ser(data[i], 0, bytes.size(), bytes.data());
      ddsi_serdata_unref(data[i]);
      Cdr cdr(std::move(bytes));
      Stamped s;
      s.representation = cdr.representation();
      s.stamp_ns = second * cdr.get<std::int32_t>();
      s.stamp_ns += cdr.get<std::uint32_t>();
      s.frame = cdr.text();
      for (std::size_t k = 0; k < values_; ++k) s.value.push_back(cdr.get<double>());
      s.whole = cdr.at_end();
      out.push_back(s);
    }
    return out;
  }

 private:
  std::size_t values_;
  DdsEntity topic_, reader_;
};

// Topic → {type name, USER_DATA, offers XCDR1 alone, reliable} of every writer, as discovery tells it.
struct Announced {
  std::string type, user_data;
  bool xcdr1_alone = false, reliable = false;
};

std::map<std::string, Announced> announced(const Participant& participant) {
  std::map<std::string, Announced> out;
  const DdsEntity reader(
      require(dds_create_reader(participant.handle(), DDS_BUILTIN_TOPIC_DCPSPUBLICATION, nullptr, nullptr),
              "reader"));
  void* samples[64] = {};
  dds_sample_info_t infos[64];
  const int n = dds_read(reader.handle(), samples, infos, 64, 64);
  for (int i = 0; i < n; ++i) {
    if (!infos[i].valid_data) continue;
    const auto& endpoint = *static_cast<const dds_builtintopic_endpoint_t*>(samples[i]);
    Announced a;
    a.type = endpoint.type_name;
    void* data = nullptr;
    std::size_t size = 0;
    if (dds_qget_userdata(endpoint.qos, &data, &size) && data)
      a.user_data.assign(static_cast<char*>(data), size);
    dds_free(data);
    std::uint32_t count = 0;
    dds_data_representation_id_t* ids = nullptr;
    if (dds_qget_data_representation(endpoint.qos, &count, &ids))
      a.xcdr1_alone = count == 1 && ids[0] == DDS_DATA_REPRESENTATION_XCDR1;
    dds_free(ids);
    dds_reliability_kind_t kind{};
    a.reliable = dds_qget_reliability(endpoint.qos, &kind, nullptr) && kind == DDS_RELIABILITY_RELIABLE;
    out[endpoint.topic_name] = a;
  }
  if (n > 0) dds_return_loan(reader.handle(), samples, n);
  return out;
}

struct Ros2Mirrored : testing::Test {
  // Two domains of Cyclone, so that samples cross the wire and are not handed over in memory.
  std::uint32_t id = static_cast<std::uint32_t>(getpid()) % 100;
  Domain daemon_domain{id, read_dds_profile("loopback")};
  Domain node_domain{id + 100, [this] {
                       std::string xml = read_dds_profile("loopback");
                       xml.replace(
                           xml.find("<Discovery>"), 11,
                           "<Discovery><ExternalDomainId>" + std::to_string(id) + "</ExternalDomainId>");
                       return xml;
                     }()};
  Participant daemon{daemon_domain}, node{node_domain};
};

TEST_F(Ros2Mirrored, APlainReaderGetsPoseTwistAndWrenchWithFrameStampAndHash) {
  Ros2Mirror mirror(daemon, device_id);
  PlainReader pose(node, geometry_msgs_msg_dds__PoseStamped__desc, "rt/haptic/3/pose", 7);
  PlainReader twist(node, geometry_msgs_msg_dds__TwistStamped__desc, "rt/haptic/3/twist", 6);
  PlainReader wrench(node, geometry_msgs_msg_dds__WrenchStamped__desc, "rt/haptic/3/wrench", 6);
  ASSERT_TRUE(within_two_seconds([&] { return pose.matched() && twist.matched() && wrench.matched(); }));

  const std::map<std::string, Announced> writers = announced(node);
  const std::map<std::string, std::pair<std::string, std::string>> expected = {
      {"rt/haptic/3/pose",
       {"PoseStamped_", "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"}},
      {"rt/haptic/3/twist",
       {"TwistStamped_", "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64"}},
      {"rt/haptic/3/wrench",
       {"WrenchStamped_", "8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77"}}};
  for (const auto& [topic, type_and_hash] : expected) {
    ASSERT_TRUE(writers.contains(topic)) << topic;
    const Announced& a = writers.at(topic);
    EXPECT_EQ(a.type, "geometry_msgs::msg::dds_::" + type_and_hash.first);
    EXPECT_EQ(a.user_data, "typehash=RIHS01_" + type_and_hash.second + ";");
    EXPECT_TRUE(a.xcdr1_alone) << topic;
    EXPECT_TRUE(a.reliable) << topic;
  }

  std::vector<Stamped> poses, twists, wrenches;
  const auto gather = [](PlainReader& from, std::vector<Stamped>& into) {
    for (Stamped& s : from.take()) into.push_back(std::move(s));
  };
  const std::int64_t unix_ns = dds_time(), mono_ns = monotonic_ns();
  ForceRecord record;
  const auto publish_at = [&](std::int64_t time_ns) {
    record.time_ns = time_ns;
    record.instrument.present = true;
    record.instrument.received_ns = time_ns - 300'000;
    mirror.note(record);
    mirror.publish();
  };
  // A reader that sees its writer may not be seen by it yet, and what is written until then is lost.
  std::int64_t early_ns = mono_ns - 10'000'000'000;
  record.device.p = Vec3(0.01, -0.02, 0.03);
  ASSERT_TRUE(within_two_seconds([&] {
    publish_at(early_ns += 1'000'000);
    gather(pose, poses);
    gather(twist, twists);
    gather(wrench, wrenches);
    return !poses.empty() && !twists.empty() && !wrenches.empty();
  }));

  // 10 ms apart: 2 mm along x, and a tenth of a radian about z.
  for (int k = 0; k < 2; ++k) {
    record.device.p = Vec3(0.01 + 0.002 * k, -0.02, 0.03);
    record.device.q = Quat(std::cos(0.05 * k), 0, 0, std::sin(0.05 * k));
    record.force.force = Vec3(0.1, 0.2 + k, -0.3);
    record.force.torque = Vec3(0, 0.01, 0);
    publish_at(mono_ns - 40'000'000 + k * 10'000'000);
  }
  EXPECT_TRUE(within_two_seconds([&] {
    gather(pose, poses);
    gather(twist, twists);
    gather(wrench, wrenches);
    return poses.back().value[0] > 0.011 && twists.back().value[0] > 0.1 && wrenches.back().value[1] > 1;
  }));
  for (const std::vector<Stamped>* messages : {&poses, &twists, &wrenches}) {
    const Stamped& s = messages->back();
    EXPECT_EQ(s.representation, 0x0001);  // CDR, little endian
    EXPECT_EQ(s.frame, "haptic_3");
    EXPECT_TRUE(s.whole);
    const std::int64_t expected_ns = unix_ns - 30'000'000 - (messages == &wrenches ? 0 : 300'000);
    EXPECT_NEAR(static_cast<double>(s.stamp_ns - expected_ns), 0,
                200'000);  // two clocks read one after the other
  }
  const std::vector<double> q = {0.012, -0.02, 0.03, 0, 0, std::sin(0.05), std::cos(0.05)};
  EXPECT_EQ(poses.back().value, q);
  EXPECT_EQ(wrenches.back().value, (std::vector<double>{0.1, 1.2, -0.3, 0, 0.01, 0}));
  const std::vector<double> v = {0.2, 0, 0, 0, 0, 10};
  for (std::size_t k = 0; k < 6; ++k) EXPECT_NEAR(twists.back().value[k], v[k], 1e-9) << k;

  // Without a device: no pose, and a wrench that goes on.
  record.time_ns += 10'000'000;
  record.instrument.present = false;
  record.force.force = Vec3::Zero();
  poses.clear();
  mirror.note(record);
  mirror.publish();
  EXPECT_TRUE(within_two_seconds([&] {
    gather(wrench, wrenches);
    return wrenches.back().value[1] == 0;
  }));
  gather(pose, poses);
  EXPECT_TRUE(poses.empty());
}

TEST(Ros2Mirror, MeanTwistLeadsFromOnePoseToTheOther) {
  const Vec3 axis = Vec3(1, -2, 0.5).normalized();
  for (double angle : {0.0, 1e-12, 1e-4, 1.0, 3.0}) {
    Pose from, to;
    from.q = Quat(0.5, 0.5, -0.5, 0.5);
    to.q = Quat(Eigen::AngleAxisd(angle, axis)) * from.q;
    to.q.coeffs() = -to.q.coeffs();  // the same rotation
    to.p = Vec3(1, 2, 3);
    const Twist t = mean_twist(from, to, 0.5);
    EXPECT_LT((t.angular - 2 * angle * axis).norm(), 1e-9) << angle;
    EXPECT_EQ(t.linear, Vec3(2, 4, 6));
  }
}

// Through the diagnostics thread, as the scene's switch has it.
TEST_F(Ros2Mirrored, OnlyASceneThatAsksForItIsMirrored) {
  LoopStatistics statistics;
  Scene scene;
  scene.first().device.id = device_id;
  for (const bool asked : {false, true}) {
    scene.ros2 = asked;
    Channel<SceneSnapshot> snapshots;
    SpscQueue<ForceRecord> history(64);
    Diagnostics diagnostics(daemon, scene, statistics, snapshots, history, std::nullopt);
    diagnostics.start();
    PlainReader wrench(node, geometry_msgs_msg_dds__WrenchStamped__desc, "rt/haptic/3/wrench", 6);
    if (!asked) {
      std::this_thread::sleep_for(std::chrono::milliseconds(300));
      EXPECT_FALSE(announced(node).contains("rt/haptic/3/wrench"));
      continue;
    }
    ASSERT_TRUE(within_two_seconds([&] { return wrench.matched(); }));
    ForceRecord record;
    record.time_ns = monotonic_ns();
    record.force.force = Vec3(0, 0, 0.5);
    std::vector<Stamped> got;
    EXPECT_TRUE(within_two_seconds([&] {
      history.push(record);
      got = wrench.take();
      return !got.empty();
    }));
    ASSERT_FALSE(got.empty());
    EXPECT_EQ(got.back().value[2], 0.5);
  }
}

}  // namespace
}  // namespace hapticd
