// The messages of a recording: the same bytes as Cyclone makes of the same type, and read back by Cyclone and
// by us.
#include "server/record/ros2_messages.h"

#include <dds/ddsi/ddsi_serdata.h>
#include "idl/ros2.h"
#include <unistd.h>

#include <cstring>
#include <functional>
#include <string>

#include <gtest/gtest.h>

#include "server/dds/dds.h"

namespace hapticd {
namespace {

using Bytes = std::vector<std::uint8_t>;

// Cyclone's own encoder and decoder of a type, found through a writer and a reader in XCDR1.
class Cyclone {
 public:
  Cyclone(const Participant& participant, const dds_topic_descriptor_t& type) {
    const Qos qos(dds_create_qos(), &dds_delete_qos);
    dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    const dds_data_representation_id_t xcdr1 = DDS_DATA_REPRESENTATION_XCDR1;
    dds_qset_data_representation(qos.get(), 1, &xcdr1);
    static int number = 0;
    const std::string name = "messages" + std::to_string(++number);
    topic_ = DdsEntity(dds_create_topic(participant.handle(), &type, name.c_str(), nullptr, nullptr));
    reader_ = DdsEntity(dds_create_reader(participant.handle(), topic_.handle(), qos.get(), nullptr));
    writer_ = DdsEntity(dds_create_writer(participant.handle(), topic_.handle(), qos.get(), nullptr));
  }
  // Without the padding to four bytes at the end; the representation's options say how much that is.
  Bytes encoded(const void* message) {
    require(dds_write(writer_.handle(), message), "write");
    ddsi_serdata* data = nullptr;
    dds_sample_info_t info;
    for (int i = 0; i < 1000 && dds_takecdr(reader_.handle(), &data, 1, &info, DDS_ANY_STATE) < 1; ++i)
      usleep(1000);
    Bytes bytes(ddsi_serdata_size(data));
    ddsi_serdata_to_ser(data, 0, bytes.size(), bytes.data());
    type_ = data->type;
    ddsi_serdata_unref(data);
    return bytes;
  }
  // After `encoded`.
  bool decode(std::span<const std::uint8_t> bytes, void* message) const {
    ddsrt_iovec_t part{const_cast<std::uint8_t*>(bytes.data()), bytes.size()};
    ddsi_serdata* data = ddsi_serdata_from_ser_iov(type_, SDK_DATA, 1, &part, bytes.size());
    if (!data) return false;
    const bool done = ddsi_serdata_to_sample(data, message, nullptr, nullptr);
    ddsi_serdata_unref(data);
    return done;
  }

 private:
  DdsEntity topic_, reader_, writer_;
  const ddsi_sertype* type_ = nullptr;
};

// All of ours, then at most three bytes of padding; options in bytes 2 and 3 are Cyclone's.
void expect_same(std::span<const std::uint8_t> ours, const Bytes& theirs) {
  ASSERT_LE(ours.size(), theirs.size());
  EXPECT_LT(theirs.size() - ours.size(), 4u);
  for (std::size_t i = 0; i < ours.size(); ++i) {
    if (i != 2 && i != 3) {
      EXPECT_EQ(ours[i], theirs[i]) << i;
    }
  }
}

std_msgs_msg_dds__Header_ header(std::string& frame) { return {{1'700'000'000, 123'456'789}, frame.data()}; }

struct Ros2Messages : testing::Test {
  Domain domain{static_cast<std::uint32_t>(getpid() + 50) % 200, read_dds_profile("loopback")};
  Participant participant{domain};
  Stamp stamp{1'700'000'000'123'456'789, "haptic_3"};
  CdrWriter cdr;
};

TEST_F(Ros2Messages, APoseIsWhatCycloneMakesOfIt) {
  Pose pose;
  pose.p = {0.1, -2.5e-3, 1e-300};
  pose.q = Quat(0.5, -0.5, 0.5, 0.5);
  put_pose(cdr, stamp, pose);
  geometry_msgs_msg_dds__PoseStamped_ m{header(stamp.frame), {{0.1, -2.5e-3, 1e-300}, {-0.5, 0.5, 0.5, 0.5}}};
  Cyclone cyclone(participant, geometry_msgs_msg_dds__PoseStamped__desc);
  expect_same(cdr.bytes(), cyclone.encoded(&m));

  geometry_msgs_msg_dds__PoseStamped_ back{};
  ASSERT_TRUE(cyclone.decode(cdr.bytes(), &back));
  EXPECT_EQ(back.header.stamp.nanosec, 123'456'789u);
  EXPECT_STREQ(back.header.frame_id, "haptic_3");
  EXPECT_EQ(back.pose.position.z, 1e-300);
  EXPECT_EQ(back.pose.orientation.x, -0.5);
  dds_sample_free(&back, &geometry_msgs_msg_dds__PoseStamped__desc, DDS_FREE_CONTENTS);

  const StampedPose ours = get_pose(cdr.bytes());
  EXPECT_EQ(ours.stamp.ns, stamp.ns);
  EXPECT_EQ(ours.stamp.frame, stamp.frame);
  EXPECT_EQ(ours.pose.p, pose.p);
  EXPECT_EQ(ours.pose.q.coeffs(), pose.q.coeffs());
}

TEST_F(Ros2Messages, AWrenchIsWhatCycloneMakesOfIt) {
  put_wrench(cdr, stamp, {1, 2, 3}, {-4, -5, -6});
  geometry_msgs_msg_dds__WrenchStamped_ m{header(stamp.frame), {{1, 2, 3}, {-4, -5, -6}}};
  expect_same(cdr.bytes(), Cyclone(participant, geometry_msgs_msg_dds__WrenchStamped__desc).encoded(&m));
}

TEST_F(Ros2Messages, ButtonsAreWhatCycloneMakesOfThem) {
  put_joy(cdr, stamp, 2);
  std::int32_t buttons[] = {0, 1};
  sensor_msgs_msg_dds__Joy_ m{header(stamp.frame), {}, {2, 2, buttons, false}};
  expect_same(cdr.bytes(), Cyclone(participant, sensor_msgs_msg_dds__Joy__desc).encoded(&m));
  EXPECT_EQ(get_joy(cdr.bytes()).buttons, 2u);
}

TEST_F(Ros2Messages, ADiagnosticIsWhatCycloneMakesOfIt) {
  put_diagnostic(cdr, stamp, {0, Diagnostic::warning, "hapticd", "late", {{"ticks", "12"}, {"", "x"}}},
                 "haptic_3");
  std::string name = "hapticd", message = "late", hardware = "haptic_3", k1 = "ticks", v1 = "12", k2,
              v2 = "x";
  diagnostic_msgs_msg_dds__KeyValue_ values[] = {{k1.data(), v1.data()}, {k2.data(), v2.data()}};
  diagnostic_msgs_msg_dds__DiagnosticStatus_ status{
      1, name.data(), message.data(), hardware.data(), {2, 2, values, false}};
  diagnostic_msgs_msg_dds__DiagnosticArray_ m{header(stamp.frame), {1, 1, &status, false}};
  expect_same(cdr.bytes(), Cyclone(participant, diagnostic_msgs_msg_dds__DiagnosticArray__desc).encoded(&m));
}

TEST(Ros2Message, TimesBefore1970HaveNanosecondsThatAreNotNegative) {
  CdrWriter cdr;
  put_pose(cdr, {-1, ""}, {});
  CdrReader in(cdr.bytes());
  EXPECT_EQ(in.get<std::int32_t>(), -1);
  EXPECT_EQ(in.get<std::uint32_t>(), 999'999'999u);
  EXPECT_EQ(get_pose(cdr.bytes()).stamp.ns, -1);
}

TEST(Ros2Message, BigEndianIsReadAndAnythingElseRefused) {
  // 0x0000, then: sec 1, nanosec 2, frame "", and positions 1, −2, 0.5 behind padding to 8.
  const Bytes big = {0, 0,    0,    0, 0, 0, 0, 1, 0, 0,    0, 2,    0,    0, 0, 1, 0, 0,    0,
                     0, 0x3f, 0xf0, 0, 0, 0, 0, 0, 0, 0xc0, 0, 0,    0,    0, 0, 0, 0, 0x3f, 0xe0,
                     0, 0,    0,    0, 0, 0, 0, 0, 0, 0,    0, 0,    0,    0, 0, 0, 0, 0,    0,
                     0, 0,    0,    0, 0, 0, 0, 0, 0, 0,    0, 0x3f, 0xf0, 0, 0, 0, 0, 0,    0};
  const StampedPose pose = get_pose(big);
  EXPECT_EQ(pose.stamp.ns, 1'000'000'002);
  EXPECT_EQ(pose.pose.p, Vec3(1, -2, 0.5));
  EXPECT_EQ(pose.pose.q.w(), 1);

  Bytes xcdr2 = big;
  xcdr2[1] = 7;
  EXPECT_THROW(get_pose(xcdr2), CdrError);
  for (std::size_t n = 0; n < big.size(); ++n) EXPECT_THROW(get_pose(std::span(big).first(n)), CdrError) << n;
}

// Beyond it the seconds that are written would overflow.
TEST(Ros2Message, ASecondHasAThousandMillionNanosecondsAtMost) {
  CdrWriter out;
  put_pose(out, {std::int64_t{INT32_MAX} * 1'000'000'000 + 999'999'999, ""}, {});
  Bytes bytes(out.bytes().begin(), out.bytes().end());
  EXPECT_EQ(get_pose(bytes).stamp.ns, std::int64_t{INT32_MAX} * 1'000'000'000 + 999'999'999);
  const std::uint32_t beyond = 1'000'000'000;
  std::memcpy(bytes.data() + 8, &beyond, sizeof beyond);
  EXPECT_THROW(get_pose(bytes), CdrError);
}

// A length that would wrap around, or that promises more than there is.
TEST(Ros2Message, LengthsAreNotBelieved) {
  CdrWriter cdr;
  put_joy(cdr, {0, "f"}, 1);
  for (std::size_t at = 4; at + 4 <= cdr.bytes().size(); at += 4) {
    Bytes bytes(cdr.bytes().begin(), cdr.bytes().end());
    for (std::size_t k = 0; k < 4; ++k) bytes[at + k] = 0xff;
    try {
      get_joy(bytes);
    } catch (const CdrError&) {
    }
  }
}

}  // namespace
}  // namespace hapticd
