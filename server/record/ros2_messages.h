// The ROS 2 messages of a recording, to and from CDR (cdr.h).
//
//   geometry_msgs/msg/PoseStamped       header, position, orientation (x, y, z, w)
//   geometry_msgs/msg/TransformStamped  header, child frame, translation, rotation; read only
//   geometry_msgs/msg/WrenchStamped     header, force, torque
//   sensor_msgs/msg/Joy                 header, no axes, buttons 0 or 1 each: bit 0 first
//   diagnostic_msgs/msg/DiagnosticArray header, statuses of level, name, message, hardware id and values
//
// Units: m, N, N·m; stamps in ns since 1970. Errors: the readers throw CdrError.
// Source: the .msg files of common_interfaces.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "physics/types.h"
#include "server/record/cdr.h"

namespace hapticd {

struct Stamp {
  std::int64_t ns = 0;
  std::string frame;
};

struct StampedPose {
  Stamp stamp;
  Pose pose;  // as stored: the quaternion may be anything
};

struct StampedButtons {
  Stamp stamp;
  std::uint32_t buttons = 0;
};

struct Diagnostic {
  enum Level : std::uint8_t { ok, warning, error, stale };
  std::int64_t time_ns = 0;
  Level level = ok;
  std::string name, message;
  std::vector<std::pair<std::string, std::string>> values;
};

void put_pose(CdrWriter& out, const Stamp& stamp, const Pose& pose);
void put_wrench(CdrWriter& out, const Stamp& stamp, const Vec3& force, const Vec3& torque);
void put_joy(CdrWriter& out, const Stamp& stamp, std::uint32_t buttons);
void put_diagnostic(CdrWriter& out, const Stamp& stamp, const Diagnostic& diagnostic,
                    const std::string& hardware);

StampedPose get_pose(std::span<const std::uint8_t> cdr);
StampedPose get_transform(std::span<const std::uint8_t> cdr);
// Buttons beyond the 32nd are left out.
StampedButtons get_joy(std::span<const std::uint8_t> cdr);

}  // namespace hapticd
