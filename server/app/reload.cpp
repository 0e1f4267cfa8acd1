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

void flatten(const YAML::Node& node, const std::string& path, FlatYaml& out) {
  if (node.IsMap())
    for (const auto& entry : node)
      flatten(entry.second, path.empty() ? entry.first.Scalar() : path + "." + entry.first.Scalar(), out);
  else if (node.IsSequence())
    for (std::size_t i = 0; i < node.size(); ++i) flatten(node[i], path + "[" + std::to_string(i) + "]", out);
  else if (node.IsScalar())
    out[path] = node.Scalar();
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

// Of what only the start can make.
bool needs_restart(const std::string& key) {
  return key == "haptic.mode" || key == "ros2" || key == "device" || key.ends_with(".device") ||
         key.ends_with(".id") || (key.starts_with("more_devices") && !key.ends_with("position_scale"));
}

// Keys that are there on one side only, or with another value.
std::vector<std::string> changed(const FlatYaml& a, const FlatYaml& b) {
  std::set<std::string> keys;
  for (const auto& [key, value] : a)
    if (const auto other = b.find(key); other == b.end() || other->second != value) keys.insert(key);
  for (const auto& [key, value] : b)
    if (!a.contains(key)) keys.insert(key);
  return {keys.begin(), keys.end()};
}

// The instruments' devices, then the further ones, which are driven as the first is.
std::vector<ReloadedDevice> devices_of(const Scene& scene, const FlatYaml& keys) {
  std::vector<ReloadedDevice> all;
  for (const SceneInstrument& held : scene.instruments)
    all.push_back({held.device.id, held.device_file.string(), held.coupling.stiffness, held.device_stiffness,
                   tuning_of(held.device)});
  for (std::size_t i = 0; i < scene.more_devices.size(); ++i) {
    const auto name = keys.find("more_devices[" + std::to_string(i) + "].device");
    all.push_back({scene.more_devices[i].id, name == keys.end() ? "" : name->second,
                   scene.first().coupling.stiffness, scene.first().device_stiffness,
                   tuning_of(scene.more_devices[i])});
  }
  return all;
}

}  // namespace

FlatYaml flat_yaml(const fs::path& file) {
  FlatYaml out;
  flatten(YAML::LoadFile(file.string()), "", out);
  return out;
}

Reloader::Reloader(const Scene& scene, const std::string& device, const std::vector<std::string>& also)
    : file_(scene.file),
      device_(device),
      also_(also),
      log_level_(scene.log_level),
      keys_(flat_yaml(scene.file)),
      started_(devices_of(scene, keys_)),
      meshes_(meshes_of(scene)) {
  for (const ReloadedDevice& d : started_) now_.push_back(d.tuning);
  for (const SceneInstrument& held : scene.instruments)
    device_keys_.emplace(held.device_file, flat_yaml(held.device_file));
}

Reloader::Meshes Reloader::meshes_of(const Scene& scene) {
  Meshes meshes;
  for (const SceneBody& body : scene.bodies)
    meshes.emplace_back(body.mesh_file, fs::last_write_time(body.mesh_file));
  return meshes;
}

void Reloader::begun_anew() {
  keys_ = newest_keys_;
  meshes_ = newest_meshes_;
}

// now: the tuning of `started` that is asked for at present; gets what is given.
void Reloader::retune(const ReloadedDevice& started, const ReloadedDevice& wanted, DeviceTuning& now,
                      Reload& r) const {
  DeviceTuning asked = now;
  for (const Field& f : fields)
    if (!f.in_device_file || wanted.source == started.source) asked.*f.value = wanted.tuning.*f.value;
  const DeviceTuning given = clamped(asked, started.tuning, started.coupling, started.stiffness);
  const std::string who = "device " + std::to_string(started.id) + ": ";
  for (const Field& f : fields) {
    const double before = now.*f.value, after = given.*f.value;
    if (after != before) r.taken.push_back(who + f.name + " " + shown(before) + " → " + shown(after));
    if (after != asked.*f.value)
      r.clamped.push_back(who + f.name + " " + shown(asked.*f.value) + " is beyond " +
                          (f.in_device_file ? "what the device started with"
                           : f.value == &DeviceTuning::position_scale
                               ? "a quarter to four times what it started with"
                               : "what the device displays stably") +
                          ": " + shown(after));
  }
  now = given;
}

Reload Reloader::read() {
  Scene scene = read_scene(file_, device_);
  for (const std::string& name : also_) add_device(scene, name);
  const FlatYaml keys = flat_yaml(file_);
  const std::vector<ReloadedDevice> wanted = devices_of(scene, keys);
  Reload r;
  r.log_level = scene.log_level;
  r.tunings = now_;
  if (r.log_level != log_level_) r.taken.push_back("logging.level " + log_level_ + " → " + r.log_level);

  if (wanted.size() == started_.size())
    for (std::size_t i = 0; i < started_.size(); ++i)
      for (const ReloadedDevice& w : wanted)
        if (w.id == started_[i].id) retune(started_[i], w, r.tunings[i], r);

  const bool same_devices = std::ranges::equal(wanted, started_, {}, &ReloadedDevice::id, &ReloadedDevice::id);
  for (const std::string& key : changed(keys_, keys)) {
    if (is_taken(key)) continue;
    if (same_devices && !needs_restart(key))
      r.anew.push_back(key);
    else
      r.not_taken.push_back(key + " (restart for it)");
  }
  for (const auto& [file, keys_at_start] : device_keys_) {
    const bool used = std::any_of(scene.instruments.begin(), scene.instruments.end(),
                                  [&](const SceneInstrument& held) { return held.device_file == file; });
    if (!used) continue;
    for (const std::string& key : changed(keys_at_start, flat_yaml(file)))
      if (key == "id" || key == "max_stiffness")
        r.not_taken.push_back(file.string() + ": " + key + " (restart for it)");
  }
  newest_keys_ = keys;
  newest_meshes_ = meshes_of(scene);
  // Another file is another key.
  for (const auto& [mesh, written] : newest_meshes_) {
    const auto before = std::ranges::find(meshes_, mesh, &Meshes::value_type::first);
    if (before == meshes_.end() || before->second == written) continue;
    if (same_devices)
      r.anew.push_back(mesh.string() + ": a newer mesh");
    else
      r.not_taken.push_back(mesh.string() + ": a newer mesh (restart for it)");
  }
  if (!r.anew.empty()) r.scene = std::move(scene);
  now_ = r.tunings;
  log_level_ = r.log_level;
  return r;
}

}  // namespace hapticd
