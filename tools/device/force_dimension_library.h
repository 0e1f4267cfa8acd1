// What this project calls of libdhd, as the Force Dimension SDK declares it (dhdc.h, 3.3 and later): constants
// and functions, without the maker's header. −1 as `id` is the device opened last.
#pragma once

#include <string>

#include "tools/device/shared_library.h"

namespace hapticd::dhd {

inline constexpr int falcon = 60;           // dhdGetSystemType
inline constexpr int status_count = 16;     // DHD_MAX_STATUS
inline constexpr std::size_t status_connected = 1, status_reset = 3, status_force = 5, status_cause = 14;
inline constexpr int cause_none = 0, cause_button = 1, cause_dead_man = 6;  // DHD_FORCEOFF_…
inline constexpr double watchdog_unit_s = 125e-6;

struct Library {
  SharedLibrary library;
  int (*device_count)();
  int (*open)();
  int (*open_id)(char id);
  int (*close)(char id);
  const char* (*last_error)();
  const char* (*system_name)(char id);
  int (*system_type)(char id);
  int (*enable_force)(unsigned char on, char id);
  int (*position)(double* x, double* y, double* z, char id);
  unsigned int (*button_mask)(char id);
  int (*set_force)(double x, double y, double z, char id);
  // Not in every version; null where it is not.
  int (*serial_number)(unsigned short* number, char id) = nullptr;
  bool (*is_left_handed)(char id) = nullptr;
  bool (*has_wrist)(char id) = nullptr;
  bool (*has_active_wrist)(char id) = nullptr;
  bool (*has_gripper)(char id) = nullptr;
  int (*emulate_button)(unsigned char on, char id) = nullptr;
  int (*pose)(double* x, double* y, double* z, double rotation[3][3], char id) = nullptr;
  int (*set_wrench)(double fx, double fy, double fz, double tx, double ty, double tz, double gripper,
                    char id) = nullptr;
  int (*status)(int status[status_count], char id) = nullptr;
  int (*set_watchdog)(unsigned char duration, char id) = nullptr;

  Library(const std::vector<std::string>& names, const std::string& path) : library(names, path) {
    library.need("dhdGetDeviceCount", device_count);
    library.need("dhdOpen", open);
    library.need("dhdOpenID", open_id);
    library.need("dhdClose", close);
    library.need("dhdErrorGetLastStr", last_error);
    library.need("dhdGetSystemName", system_name);
    library.need("dhdGetSystemType", system_type);
    library.need("dhdEnableForce", enable_force);
    library.need("dhdGetPosition", position);
    library.need("dhdGetButtonMask", button_mask);
    library.need("dhdSetForce", set_force);
    library.find("dhdGetSerialNumber", serial_number);
    library.find("dhdIsLeftHanded", is_left_handed);
    library.find("dhdHasWrist", has_wrist);
    library.find("dhdHasActiveWrist", has_active_wrist);
    library.find("dhdHasGripper", has_gripper);
    library.find("dhdEmulateButton", emulate_button);
    library.find("dhdGetPositionAndOrientationFrame", pose);
    library.find("dhdSetForceAndTorqueAndGripperForce", set_wrench);
    library.find("dhdGetStatus", status);
    library.find("dhdSetWatchdog", set_watchdog);
  }
};

}  // namespace hapticd::dhd
