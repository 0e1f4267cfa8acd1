// Reading a scene again while it runs (SIGHUP, `haptic reload`): what can be taken, and what needs a restart.
//
//   taken       limits of the device files, mapping.position_scale, mapping.force_scale, logging.level
//   clamped     haptic/tuning.h
//   anew        every other key whose value changed, and meshes whose file is newer: the simulation begins again
//               with the scene as it now is, the devices at zero meanwhile (Daemon::restart)
//   not taken   which devices there are and how they are driven: more_devices, device, ids, haptic.mode, ros2;
//               where the devices' ids changed, all that would be anew
//
// A device is found again by its id: one that is no longer there stays as it is, and all do where their
// number is another. A device whose file is another than at the start keeps its limits. Errors: read throws
// InputError as the scene's reader does; nothing is taken then. Thread safety: one thread.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "haptic/tuning.h"
#include "server/scene/scene.h"

namespace hapticd {

// Every scalar of a YAML file under its whole key: mapping.origin[2] → "0.01".
using FlatYaml = std::map<std::string, std::string>;
FlatYaml flat_yaml(const std::filesystem::path& file);

struct Reload {
  std::vector<DeviceTuning> tunings;  // in the order of the start: instruments, then more_devices
  std::string log_level;
  std::vector<std::string> taken;      // "device 0: max_force 3.3 → 2"
  std::vector<std::string> clamped;    // what was asked for and is not safe
  std::vector<std::string> anew;       // "simulation.rate"
  std::vector<std::string> not_taken;  // "haptic.mode (restart for it)"
  std::optional<Scene> scene;          // where something is anew
};

// A device as a scene describes it.
struct ReloadedDevice {
  std::uint32_t id = 0;
  std::string source;  // what says its limits: a file, or the name of it
  double coupling = 0, stiffness = 0;
  DeviceTuning tuning;
};

class Reloader {
 public:
  // As the daemon was started. scene: as read, before any plan.
  Reloader(const Scene& scene, const std::string& device, const std::vector<std::string>& also);

  Reload read();
  // The simulation began anew with the scene that was read last.
  void begun_anew();

 private:
  void retune(const ReloadedDevice& started, const ReloadedDevice& wanted, DeviceTuning& now,
              Reload& r) const;

  std::filesystem::path file_;
  std::string device_;
  std::vector<std::string> also_;
  std::string log_level_;
  FlatYaml keys_;
  std::vector<ReloadedDevice> started_;
  std::vector<DeviceTuning> now_;
  std::map<std::filesystem::path, FlatYaml> device_keys_;
  using Meshes = std::vector<std::pair<std::filesystem::path, std::filesystem::file_time_type>>;
  static Meshes meshes_of(const Scene& scene);
  Meshes meshes_;
  FlatYaml newest_keys_;
  Meshes newest_meshes_;
};

}  // namespace hapticd
