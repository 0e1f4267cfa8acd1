// The kinds of devices that a driver exists for: what each is called, needs and fits.
//
// Errors: `device_kind` throws std::invalid_argument naming the kinds there are; `open_device` what the kind's
// own file says, and MissingLibrary where nothing is installed for it.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "tools/device/vendor_device.h"

namespace hapticd {

struct DeviceKind {
  const char* name;
  const char* devices;  // that it is for
  const char* limits;   // of config/devices, where a device's own name tells nothing better
  const char* source;   // who has what is missing
};

// Where to look, and for which device of several; empty: the kind's own default, the first.
struct DevicePlace {
  std::string library;  // a path
  std::string service;  // PORT or HOST:PORT
  std::string device;   // as `device list` names it
};

// What of a kind is here.
struct KindHere {
  std::string library;               // that was loaded, or the service's address; empty: none
  std::string missing;               // why there is none
  std::vector<std::string> devices;  // "0: omega.6, …"
  std::string none;                  // why no device could be opened
  std::string limits;                // the file that fits the first device, or the kind
};

std::span<const DeviceKind> device_kinds();
const DeviceKind& device_kind(const std::string& name);
std::unique_ptr<VendorDevice> open_device(const DeviceKind& kind, const DevicePlace& place);
KindHere look_for(const DeviceKind& kind, const DevicePlace& place);

// The file of config/devices that fits a device of that name.
std::string limits_of(const DeviceKind& kind, const std::string& device_name);

}  // namespace hapticd
