// The options of `haptic device`, declared once: for `haptic`, which has the help and the manual page, and for
// haptic_device, the program that it becomes.
#pragma once

#include <string>

#include "tools/device/device_kinds.h"

namespace CLI {
class App;
}

namespace hapticd {

struct DeviceRunOptions {
  std::string kind, limits, secure, json;
  DevicePlace place;
  std::uint32_t id = 0, domain = 0;
  unsigned dead_man = 0;
  double duration = 0;
  bool force = false, open_network = false;
  std::string station;
};

struct DeviceApp {
  CLI::App* app = nullptr;
  CLI::App* list = nullptr;
  CLI::App* run = nullptr;
};

DeviceApp add_device_options(CLI::App& application, DeviceRunOptions& options);

}  // namespace hapticd
