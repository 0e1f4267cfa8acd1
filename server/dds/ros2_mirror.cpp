#include "server/dds/ros2_mirror.h"

#include <cmath>

#include "haptic/clock.h"

namespace hapticd {
namespace {

constexpr const char* pose_hash = "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8";
constexpr const char* twist_hash = "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64";
constexpr const char* wrench_hash = "8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77";

Qos mirror_qos(const char* hash) {
  Qos qos(dds_create_qos(), &dds_delete_qos);
  // No wait at all: a reader that does not keep up loses messages, the diagnostics thread loses no time.
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, 0);
  dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
  const dds_data_representation_id_t xcdr1 = DDS_DATA_REPRESENTATION_XCDR1;
  dds_qset_data_representation(qos.get(), 1, &xcdr1);
  const std::string user_data = std::string("typehash=RIHS01_") + hash + ";";
  dds_qset_userdata(qos.get(), user_data.data(), user_data.size());
  return qos;
}

geometry_msgs_msg_dds__Vector3_ vector_of(const Vec3& v) noexcept { return {v.x(), v.y(), v.z()}; }

}  // namespace

Twist mean_twist(const Pose& from, const Pose& to, double seconds) noexcept {
  Quat turn = to.q * from.q.conjugate();
  if (turn.w() < 0) turn.coeffs() = -turn.coeffs();
  const double sine = turn.vec().norm();
  // angle / sine → 2 for small turns
  const double scale = sine > 1e-9 ? 2 * std::atan2(sine, turn.w()) / sine : 2.0;
  return {(to.p - from.p) / seconds, scale / seconds * turn.vec()};
}

Ros2Mirror::Ros2Mirror(const Participant& participant, std::uint32_t device_id)
    : device_id_(device_id),
      frame_("haptic_" + std::to_string(device_id)),
      pose_(writer(participant, geometry_msgs_msg_dds__PoseStamped__desc, "pose", pose_hash)),
      twist_(writer(participant, geometry_msgs_msg_dds__TwistStamped__desc, "twist", twist_hash)),
      wrench_(writer(participant, geometry_msgs_msg_dds__WrenchStamped__desc, "wrench", wrench_hash)) {}

Ros2Mirror::RosWriter Ros2Mirror::writer(const Participant& participant, const dds_topic_descriptor_t& type,
                                         const char* name, const char* hash) const {
  const std::string topic_name = "rt/haptic/" + std::to_string(device_id_) + "/" + name;
  const Qos qos = mirror_qos(hash);
  RosWriter w;
  w.topic =
      DdsEntity(require(dds_create_topic(participant.handle(), &type, topic_name.c_str(), nullptr, nullptr),
                        "topic " + topic_name));
  w.entity = DdsEntity(require(dds_create_writer(participant.handle(), w.topic.handle(), qos.get(), nullptr),
                               "writer of " + topic_name));
  return w;
}

void Ros2Mirror::note(const ForceRecord& record) noexcept { newest_ = record; }

std_msgs_msg_dds__Header_ Ros2Mirror::header(std::int64_t monotonic_time_ns) noexcept {
  const std::int64_t unix_ns = dds_time() - (monotonic_ns() - monotonic_time_ns);
  std_msgs_msg_dds__Header_ h{};
  h.stamp.sec = static_cast<std::int32_t>(unix_ns / 1'000'000'000);
  h.stamp.nanosec = static_cast<std::uint32_t>(unix_ns % 1'000'000'000);
  h.frame_id = frame_.data();
  return h;
}

void Ros2Mirror::publish() noexcept {
  if (!newest_) return;
  const ForceRecord now = *newest_;
  newest_.reset();

  geometry_msgs_msg_dds__WrenchStamped_ wrench{};
  wrench.header = header(now.time_ns);
  wrench.wrench.force = vector_of(now.force.force);
  wrench.wrench.torque = vector_of(now.force.torque);
  dds_write(wrench_.entity.handle(), &wrench);

  if (!now.instrument.present) {
    mark_.reset();
    return;
  }
  const std::int64_t state_ns = now.instrument.received_ns;
  if (mark_ && state_ns <= mark_->instrument.received_ns) return;  // that one is published
  geometry_msgs_msg_dds__PoseStamped_ pose{};
  pose.header = header(state_ns);
  pose.pose.position = {now.device.p.x(), now.device.p.y(), now.device.p.z()};
  pose.pose.orientation = {now.device.q.x(), now.device.q.y(), now.device.q.z(), now.device.q.w()};
  dds_write(pose_.entity.handle(), &pose);

  if (mark_) {
    const Twist t = mean_twist(mark_->device, now.device,
                               1e-9 * static_cast<double>(state_ns - mark_->instrument.received_ns));
    geometry_msgs_msg_dds__TwistStamped_ twist{};
    twist.header = pose.header;
    twist.twist.linear = vector_of(t.linear);
    twist.twist.angular = vector_of(t.angular);
    dds_write(twist_.entity.handle(), &twist);
  }
  mark_ = now;
}

}  // namespace hapticd
