#include "server/scene/device_reader.h"

#include <algorithm>

#include "server/files/paths.h"
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

std::string no_such_device(const std::string& name, const std::filesystem::path& file) {
  if (std::filesystem::path(name).has_parent_path() || std::filesystem::path(name).has_extension())
    return "no such file: " + file.string();
  std::vector<std::string> known;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(file.parent_path(), error))
    if (entry.path().extension() == ".yaml") known.push_back(entry.path().stem().string());
  std::sort(known.begin(), known.end());
  const std::string hint = did_you_mean(name, known);
  return "no device '" + name + "' in " + file.parent_path().string() + " (" +
         (hint.empty() ? "" : hint + " ") + "there are: " + (known.empty() ? "none" : listed(known)) +
         "; or name a file)";
}

DeviceFile read_named_device(const std::string& name_or_path, const std::filesystem::path& base) {
  const std::filesystem::path file = device_path(name_or_path, base);
  std::error_code error;
  if (!std::filesystem::exists(file, error) && !error)
    throw InputError(file, 0, "device", no_such_device(name_or_path, file));
  return read_device(file);
}

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
