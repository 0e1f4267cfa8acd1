// Reading a scene again while it runs (SIGHUP): what can be taken, and what needs a restart.
//
//   taken       limits of the device files, mapping.position_scale, mapping.force_scale, logging.level
//   clamped     haptic/tuning.h
//   not taken   every other key whose value is another than at the start, and meshes whose file is newer
//
// A device whose file is another than at the start keeps its limits. Errors: read throws InputError as the
// scene's reader does; nothing is taken then. Thread safety: one thread.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "haptic/tuning.h"
#include "server/scene/scene.h"

namespace hapticd {

// Every scalar of a YAML file under its whole key: mapping.origin[2] → "0.01".
std::map<std::string, std::string> flat_yaml(const std::filesystem::path& file);

struct Reload {
  std::vector<DeviceTuning> tunings;  // of the scene's devices in their order
  std::string log_level;
  std::vector<std::string> taken;      // "device 0: max_force 3.3 → 2"
  std::vector<std::string> clamped;    // what was asked for and is not safe
  std::vector<std::string> not_taken;  // "simulation.rate (restart for it)"
};

class Reloader {
 public:
  // As the daemon was started. scene: as read, before any plan.
  Reloader(const Scene& scene, const std::string& device, const std::vector<std::string>& also);

  Reload read();

 private:
  std::filesystem::path file_, device_file_;
  std::string device_;
  std::vector<std::string> also_;
  double coupling_, stiffness_;
  std::vector<DeviceTuning> started_, now_;
  std::string log_level_;
  std::map<std::string, std::string> keys_, device_keys_;
  std::vector<std::pair<std::filesystem::path, std::filesystem::file_time_type>> meshes_;
};

}  // namespace hapticd
