#include "server/app/reload.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <set>
#include <sstream>

#include "server/scene/scene_reader.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

struct Field {
  const char* name;
  double DeviceTuning::*value;
  bool in_device_file;
};
constexpr std::array<Field, 8> fields = {{{"max_force", &DeviceTuning::max_force, true},
                                          {"max_torque", &DeviceTuning::max_torque, true},
                                          {"max_force_rate", &DeviceTuning::max_force_rate, true},
                                          {"max_speed", &DeviceTuning::max_speed, true},
                                          {"workspace_radius", &DeviceTuning::workspace_radius, true},
                                          {"damping", &DeviceTuning::damping, true},
                                          {"position_scale", &DeviceTuning::position_scale, false},
                                          {"force_scale", &DeviceTuning::force_scale, false}}};

void flatten(const YAML::Node& node, const std::string& path, std::map<std::string, std::string>& out) {
  if (node.IsMap())
    for (const auto& entry : node)
      flatten(entry.second, path.empty() ? entry.first.Scalar() : path + "." + entry.first.Scalar(), out);
  else if (node.IsSequence())
    for (std::size_t i = 0; i < node.size(); ++i) flatten(node[i], path + "[" + std::to_string(i) + "]", out);
  else if (node.IsScalar())
    out[path] = node.Scalar();
}

std::vector<DeviceTuning> tunings_of(const Scene& scene) {
  std::vector<DeviceTuning> all = {tuning_of(scene.device)};
  for (const DeviceSettings& d : scene.more_devices) all.push_back(tuning_of(d));
  return all;
}

std::string shown(double x) {
  std::ostringstream out;
  out << x;
  return out.str();
}

bool is_taken(const std::string& key) {
  return key == "logging.level" || key.ends_with("mapping.position_scale") ||
         key.ends_with("mapping.force_scale");
}

// Keys that are there on one side only, or with another value.
std::vector<std::string> changed(const std::map<std::string, std::string>& a,
                                 const std::map<std::string, std::string>& b) {
  std::set<std::string> keys;
  for (const auto& [key, value] : a)
    if (const auto other = b.find(key); other == b.end() || other->second != value) keys.insert(key);
  for (const auto& [key, value] : b)
    if (!a.contains(key)) keys.insert(key);
  return {keys.begin(), keys.end()};
}

}  // namespace

std::map<std::string, std::string> flat_yaml(const fs::path& file) {
  std::map<std::string, std::string> out;
  flatten(YAML::LoadFile(file.string()), "", out);
  return out;
}

Reloader::Reloader(const Scene& scene, const std::string& device, const std::vector<std::string>& also)
    : file_(scene.file),
      device_file_(scene.device_file),
      device_(device),
      also_(also),
      coupling_(scene.coupling.stiffness),
      stiffness_(scene.device_stiffness),
      started_(tunings_of(scene)),
      now_(started_),
      log_level_(scene.log_level),
      keys_(flat_yaml(scene.file)),
      device_keys_(flat_yaml(scene.device_file)) {
  for (const SceneBody& body : scene.bodies)
    meshes_.emplace_back(body.mesh_file, fs::last_write_time(body.mesh_file));
}

Reload Reloader::read() {
  Scene scene = read_scene(file_, device_);
  for (const std::string& name : also_) add_device(scene, name);
  const std::vector<DeviceTuning> wanted = tunings_of(scene);
  const std::vector<std::string> other = changed(keys_, flat_yaml(file_));
  Reload r;
  r.log_level = scene.log_level;
  r.tunings = now_;
  if (r.log_level != log_level_) r.taken.push_back("logging.level " + log_level_ + " → " + r.log_level);

  const auto is_changed = [&](const std::string& key) {
    return std::find(other.begin(), other.end(), key) != other.end();
  };
  const bool same_devices = wanted.size() == started_.size();
  for (std::size_t i = 0; same_devices && i < wanted.size(); ++i) {
    const std::string entry = "more_devices[" + std::to_string(i - 1) + "].";
    const bool same_file = i == 0 ? scene.device_file == device_file_
                                  : !is_changed(entry + "device") && !is_changed(entry + "id");
    DeviceTuning asked = now_[i];
    for (const Field& f : fields)
      if (!f.in_device_file || same_file) asked.*f.value = wanted[i].*f.value;
    const DeviceTuning given = clamped(asked, started_[i], coupling_, stiffness_);
    const std::string who =
        "device " + std::to_string(i == 0 ? scene.device.id : scene.more_devices[i - 1].id) + ": ";
    for (const Field& f : fields) {
      const double before = now_[i].*f.value, after = given.*f.value;
      if (after != before) r.taken.push_back(who + f.name + " " + shown(before) + " → " + shown(after));
      if (after != asked.*f.value)
        r.clamped.push_back(
            who + f.name + " " + shown(asked.*f.value) + " is beyond " +
            (f.in_device_file ? "what the device started with" : "what the device displays stably") + ": " +
            shown(after));
    }
    r.tunings[i] = given;
  }
  for (const std::string& key : other)
    if (!is_taken(key)) r.not_taken.push_back(key + " (restart for it)");
  if (scene.device_file == device_file_)
    for (const char* key : {"max_stiffness", "id"})
      for (const std::string& c : changed(device_keys_, flat_yaml(device_file_)))
        if (c == key) r.not_taken.push_back(device_file_.string() + ": " + c + " (restart for it)");
  for (const auto& [mesh, written] : meshes_) {
    std::error_code error;
    const auto newest = fs::last_write_time(mesh, error);
    if (!error && newest != written) r.not_taken.push_back(mesh.string() + ": a newer mesh (restart for it)");
  }
  now_ = r.tunings;
  log_level_ = r.log_level;
  return r;
}

}  // namespace hapticd
