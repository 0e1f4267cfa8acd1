#include "server/record/device_bag.h"

#include <time.h>

#include "haptic/clock.h"

namespace hapticd {

DeviceBag::DeviceBag(const std::filesystem::path& directory, std::uint32_t device_id, std::int64_t offset_ns)
    : offset_ns_(offset_ns), hardware_("haptic_" + std::to_string(device_id)), bag_(directory) {
  stamp_.frame = hardware_;
  const std::string prefix = "/haptic/" + std::to_string(device_id) + "/";
  pose_ = bag_.add_topic(prefix + "pose", "geometry_msgs/msg/PoseStamped");
  wrench_ = bag_.add_topic(prefix + "wrench", "geometry_msgs/msg/WrenchStamped");
  joy_ = bag_.add_topic(prefix + "buttons", "sensor_msgs/msg/Joy");
  diagnostics_ = bag_.add_topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray");
}

void DeviceBag::note(const ForceRecord& r) noexcept {
  const std::int64_t time_ns = r.time_ns + offset_ns_;
  if (r.force.answers) {
    stamp_.ns = client_.stamp(r.force.echo_sequence, r.force.echo_client_time_ns, r.instrument.received_ns) +
                offset_ns_;
    put_pose(cdr_, stamp_, r.device);
    bag_.write(pose_, time_ns, cdr_.bytes());
    if (!began_ || r.instrument.buttons != buttons_) {
      put_joy(cdr_, stamp_, r.instrument.buttons);
      bag_.write(joy_, time_ns, cdr_.bytes());
    }
    began_ = true;
    buttons_ = r.instrument.buttons;
  }
  stamp_.ns = time_ns;
  put_wrench(cdr_, stamp_, r.force.force, r.force.torque);
  bag_.write(wrench_, time_ns, cdr_.bytes());
}

void DeviceBag::note(const Diagnostic& d) noexcept {
  stamp_.ns = d.time_ns + offset_ns_;
  Stamp stamp = stamp_;
  stamp.frame.clear();
  put_diagnostic(cdr_, stamp, d, hardware_);
  bag_.write(diagnostics_, stamp.ns, cdr_.bytes());
}

std::int64_t realtime_offset_ns() noexcept {
  timespec wall{};
  const std::int64_t before = monotonic_ns();
  clock_gettime(CLOCK_REALTIME, &wall);
  const std::int64_t after = monotonic_ns();
  return std::int64_t{1'000'000'000} * wall.tv_sec + wall.tv_nsec - (before + after) / 2;
}

}  // namespace hapticd
