#include "server/record/ros2_messages.h"

namespace hapticd {
namespace {

constexpr std::int64_t second = 1'000'000'000;
constexpr int button_count = 2;  // haptic/device.h

void put_header(CdrWriter& out, const Stamp& stamp) {
  out.clear();
  // Nanoseconds are never negative, seconds may be.
  const std::int64_t nanoseconds = (stamp.ns % second + second) % second;
  out.put(static_cast<std::int32_t>((stamp.ns - nanoseconds) / second));
  out.put(static_cast<std::uint32_t>(nanoseconds));
  out.text(stamp.frame);
}

void put_vector(CdrWriter& out, const Vec3& v) {
  for (int i = 0; i < 3; ++i) out.put(v[i]);
}

Stamp get_header(CdrReader& in) {
  Stamp stamp;
  stamp.ns = second * in.get<std::int32_t>();
  const auto nanoseconds = in.get<std::uint32_t>();
  if (nanoseconds >= second) throw CdrError("has a second of " + std::to_string(nanoseconds) + " ns");
  stamp.ns += nanoseconds;
  stamp.frame = in.text();
  return stamp;
}

Pose get_pose_value(CdrReader& in) {
  Pose pose;
  for (int i = 0; i < 3; ++i) pose.p[i] = in.get<double>();
  for (int i = 0; i < 4; ++i) pose.q.coeffs()[i] = in.get<double>();
  return pose;
}

}  // namespace

void put_pose(CdrWriter& out, const Stamp& stamp, const Pose& pose) {
  put_header(out, stamp);
  put_vector(out, pose.p);
  for (int i = 0; i < 4; ++i) out.put(pose.q.coeffs()[i]);
}

void put_wrench(CdrWriter& out, const Stamp& stamp, const Vec3& force, const Vec3& torque) {
  put_header(out, stamp);
  put_vector(out, force);
  put_vector(out, torque);
}

void put_joy(CdrWriter& out, const Stamp& stamp, std::uint32_t buttons) {
  put_header(out, stamp);
  out.put(std::uint32_t{0});
  out.put(std::uint32_t{button_count});
  for (int i = 0; i < button_count; ++i) out.put(static_cast<std::int32_t>(buttons >> i & 1u));
}

void put_diagnostic(CdrWriter& out, const Stamp& stamp, const Diagnostic& d, const std::string& hardware) {
  put_header(out, stamp);
  out.put(std::uint32_t{1});
  out.put(static_cast<std::uint8_t>(d.level));
  out.text(d.name);
  out.text(d.message);
  out.text(hardware);
  out.put(static_cast<std::uint32_t>(d.values.size()));
  for (const auto& [key, value] : d.values) {
    out.text(key);
    out.text(value);
  }
}

StampedPose get_pose(std::span<const std::uint8_t> cdr) {
  CdrReader in(cdr);
  StampedPose out;
  out.stamp = get_header(in);
  out.pose = get_pose_value(in);
  return out;
}

StampedPose get_transform(std::span<const std::uint8_t> cdr) {
  CdrReader in(cdr);
  StampedPose out;
  out.stamp = get_header(in);
  in.text();  // child frame
  out.pose = get_pose_value(in);
  return out;
}

StampedButtons get_joy(std::span<const std::uint8_t> cdr) {
  CdrReader in(cdr);
  StampedButtons out;
  out.stamp = get_header(in);
  for (std::uint32_t n = in.length(sizeof(float)); n > 0; --n) in.get<float>();
  const std::uint32_t count = in.length(sizeof(std::int32_t));
  for (std::uint32_t i = 0; i < count; ++i)
    if (in.get<std::int32_t>() != 0 && i < 32) out.buttons |= 1u << i;
  return out;
}

}  // namespace hapticd
