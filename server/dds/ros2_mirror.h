// A device as ROS 2 sees it: three topics of standard messages, published by the diagnostics thread.
//
//   topic                     type                                content
//   rt/haptic/<id>/pose       geometry_msgs/msg/PoseStamped       newest valid device pose
//   rt/haptic/<id>/twist      geometry_msgs/msg/TwistStamped      mean velocity since the message before
//   rt/haptic/<id>/wrench     geometry_msgs/msg/WrenchStamped     force and torque sent to the device
//   v = (p − p₀)/(t − t₀),   ω = 2 log(q q₀⁻¹)/(t − t₀)
//
// All three are in the device's frame, header.frame_id "haptic_<id>" (p_scene by haptic/device.h), so that
// wrench · twist is the power given to the hand. Units: m, rad, s, N, N·m. Stamps are CLOCK_REALTIME, as ROS
// time is: of pose and twist when the state came, of the wrench the tick's intended time. Without a device
// pose and twist are silent; the wrench goes on, zero.
// QoS: reliable, volatile, keep last 1, XCDR1 alone, keyless, no type information, and the type's hash in
// USER_DATA, as rmw_cyclonedds writes it ("typehash=RIHS01_…;", hashes of ROS 2 Jazzy).
// Thread safety: one thread. Errors: the constructor throws std::runtime_error; note and publish do not
// throw, a message that cannot be written is dropped.
#pragma once

#include "idl/ros2.h"  // generated from idl/ros2.idl

#include <optional>
#include <string>

#include "haptic/loop.h"
#include "server/dds/dds.h"

namespace hapticd {

struct Twist {
  Vec3 linear = Vec3::Zero();   // [m/s]
  Vec3 angular = Vec3::Zero();  // [rad/s], in the frame of the poses
};

// The constant twist that leads from one pose to the other in `seconds` > 0, the shorter way round.
Twist mean_twist(const Pose& from, const Pose& to, double seconds) noexcept;

class Ros2Mirror {
 public:
  Ros2Mirror(const Participant& participant, std::uint32_t device_id);

  // One tick of the loop; the newest noted is what publish sends.
  void note(const ForceRecord& record) noexcept;
  void publish() noexcept;

 private:
  struct RosWriter {
    DdsEntity topic, entity;
  };
  RosWriter writer(const Participant& participant, const dds_topic_descriptor_t& type, const char* name,
                   const char* hash) const;
  std_msgs_msg_dds__Header_ header(std::int64_t monotonic_time_ns) noexcept;

  std::uint32_t device_id_;
  std::string frame_;
  RosWriter pose_, twist_, wrench_;
  std::optional<ForceRecord> newest_;
  std::optional<ForceRecord> mark_;  // of the pose published last
};

}  // namespace hapticd
