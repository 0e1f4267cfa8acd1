#include "tools/device/device_kinds.h"

#include <array>
#include <stdexcept>

#include "tools/device/force_dimension.h"
#include "tools/device/inverse3.h"
#include "tools/device/openhaptics.h"
#include "tools/device/shared_library.h"

namespace hapticd {
namespace {

constexpr std::array<DeviceKind, 4> kinds = {{
    {"openhaptics", "3D Systems Touch, Touch X, Omni, Premium", "touch",
     "OpenHaptics for Linux and the Touch driver, from 3D Systems' support pages"},
    {"force-dimension", "Force Dimension omega, delta, sigma, lambda", "omega_6",
     "the Force Dimension SDK, from forcedimension.com (Software, SDK)"},
    {"falcon", "Novint Falcon", "falcon", "the Force Dimension SDK, from forcedimension.com (Software, SDK)"},
    {"inverse3", "Haply Inverse3, with a VerseGrip or without", "inverse3",
     "the Inverse service, from docs.haply.co (Haply Hub, or its package for Linux)"},
}};

enum class Way { openhaptics, dhd, service };
Way way_of(const DeviceKind& kind) {
  const std::string name = kind.name;
  return name == "openhaptics" ? Way::openhaptics : name == "inverse3" ? Way::service : Way::dhd;
}

}  // namespace

std::span<const DeviceKind> device_kinds() { return kinds; }

const DeviceKind& device_kind(const std::string& name) {
  std::string all;
  for (const DeviceKind& kind : kinds) {
    if (name == kind.name) return kind;
    all += std::string(all.empty() ? "" : ", ") + kind.name;
  }
  throw std::invalid_argument("no kind of device is called " + name + "; there are " + all);
}

std::unique_ptr<VendorDevice> open_device(const DeviceKind& kind, const DevicePlace& place) {
  switch (way_of(kind)) {
    case Way::openhaptics: return open_openhaptics(place.library, place.device);
    case Way::dhd: return open_force_dimension(place.library, place.device, std::string(kind.name) == "falcon");
    case Way::service: break;
  }
  return open_inverse3(inverse3_address(place.service), place.device);
}

KindHere look_for(const DeviceKind& kind, const DevicePlace& place) {
  KindHere here;
  here.limits = kind.limits;
  const Way way = way_of(kind);
  int devices = 1;
  try {
    if (way == Way::service) {
      const Inverse3Address address = inverse3_address(place.service);
      here.library = address.host + ":" + address.port;
    } else {
      here.library = SharedLibrary(way == Way::dhd ? force_dimension_libraries() : openhaptics_libraries(),
                                   place.library)
                         .path();
    }
    if (way == Way::dhd) devices = force_dimension_count(place.library);
  } catch (const MissingLibrary& error) {
    here.missing = error.what();
    return here;
  } catch (const std::exception& error) {
    here.none = error.what();
    return here;
  }
  if (devices == 0) here.none = "none is connected";
  for (int i = 0; i < devices; ++i) {
    DevicePlace one = place;
    if (way == Way::dhd) one.device = std::to_string(i);
    try {
      const std::string name = open_device(kind, one)->name();
      if (here.devices.empty()) here.limits = limits_of(kind, name);
      here.devices.push_back((way == Way::dhd ? one.device + ": " : "") + name);
    } catch (const MissingLibrary& error) {
      here.library.clear();
      here.missing = error.what();
    } catch (const std::exception& error) {
      here.none = error.what();
    }
  }
  return here;
}

std::string limits_of(const DeviceKind& kind, const std::string& device_name) {
  if (way_of(kind) != Way::openhaptics) return kind.limits;
  const auto says = [&](const char* word) { return device_name.find(word) != std::string::npos; };
  return says("Premium") ? "premium_1_5" : says("Omni") ? "omni" : kind.limits;
}

}  // namespace hapticd
