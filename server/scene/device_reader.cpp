#include "server/scene/device_reader.h"

#include "server/files/yaml_keys.h"

namespace hapticd {
namespace {

// Bounds that no hand-held haptic device passes; outside them a unit was mistaken.
constexpr NumberRange force{0, 200, true, false, "newtons"};
constexpr NumberRange torque{0, 20, false, false, "newton metres; 0 for a device without torques"};
constexpr NumberRange force_rate{0, 1e5, true, false, "newtons per second"};
constexpr NumberRange speed{0, 20, true, false, "metres per second"};
constexpr NumberRange radius{0, 2, true, false, "metres"};
constexpr NumberRange damping{0, 200, false, false, "newton seconds per metre"};
constexpr NumberRange quantum{0, 1e-2, false, false, "metres; 0 where it is not known"};
constexpr NumberRange stiffness{0, 1e6, true, false, "newtons per metre"};

}  // namespace

DeviceFile read_device(const std::filesystem::path& file) {
  const YamlMap yaml = YamlMap::open(file);
  yaml.only({"device", "id", "max_force", "max_torque", "max_force_rate", "max_speed", "workspace_radius",
             "max_stiffness", "damping", "quantum"});
  DeviceFile device;
  device.name = yaml.text("device");
  device.limits.id = yaml.has("id") ? static_cast<std::uint32_t>(yaml.whole("id", 0, 1'000'000)) : 0;
  device.limits.max_force = yaml.number("max_force", force);
  device.limits.max_torque = yaml.number("max_torque", torque, 0);
  device.limits.max_force_rate = yaml.number("max_force_rate", force_rate);
  device.limits.max_speed = yaml.number("max_speed", speed);
  device.limits.workspace_radius = yaml.number("workspace_radius", radius);
  device.limits.damping = yaml.number("damping", damping);
  device.limits.quantum = yaml.number("quantum", quantum, 0);
  device.max_stiffness = yaml.number("max_stiffness", stiffness);
  return device;
}

}  // namespace hapticd
