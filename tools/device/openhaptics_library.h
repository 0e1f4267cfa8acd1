// What this project calls of libHD, as the OpenHaptics API Reference declares it (HD/hdDefines.h, hdDevice.h,
// hdScheduler.h of version 3): types, constants and functions, without the maker's headers.
#pragma once

#include <string>

#include "tools/device/shared_library.h"

namespace hapticd::hd {

using Handle = unsigned int;  // HHD
inline constexpr Handle invalid_handle = 0xFFFFFFFF;

struct ErrorInfo {
  unsigned int code;  // HD_SUCCESS is 0
  int internal_code;
  Handle device;
};
inline constexpr unsigned int force_errors = 0x0200;  // … 0x02FF: HD_WARM_MOTORS, HD_EXCEEDED_MAX_FORCE, …
inline constexpr unsigned int warm_motors = 0x0200;

enum Parameter : unsigned int {
  current_buttons = 0x2000,        // int, a mask
  current_transform = 0x2052,      // 16 doubles, column-major, mm
  device_model_type = 0x2501,      // string
  device_serial_number = 0x2504,   // string
  calibration_style = 0x2555,      // int, a mask
  current_force = 0x2700,          // 3 doubles, N, base frame
  force_output = 0x4000,           // capability
};
enum Calibration : unsigned int {
  calibration_ok = 0x5000,
  calibration_needs_update = 0x5001,
  calibration_needs_manual_input = 0x5002,
};
inline constexpr int style_encoder_reset = 1, style_auto = 2, style_inkwell = 4;

using Callback = unsigned int (*)(void*);
inline constexpr unsigned int callback_done = 0, callback_continue = 1;
inline constexpr unsigned short highest_priority = 65535;

struct Library {
  SharedLibrary library;
  Handle (*init_device)(const char*);
  void (*disable_device)(Handle);
  void (*make_current)(Handle);
  void (*begin_frame)(Handle);
  void (*end_frame)(Handle);
  void (*get_integers)(unsigned int, int*);
  void (*get_doubles)(unsigned int, double*);
  void (*set_doubles)(unsigned int, const double*);
  const char* (*get_string)(unsigned int);
  void (*enable)(unsigned int);
  void (*disable)(unsigned int);
  ErrorInfo (*get_error)();
  const char* (*error_string)(unsigned int);
  unsigned int (*check_calibration)();
  void (*update_calibration)(unsigned int);
  void (*start_scheduler)();
  void (*stop_scheduler)();
  unsigned long (*schedule)(Callback, void*, unsigned short);
  void (*unschedule)(unsigned long);

  Library(const std::vector<std::string>& names, const std::string& path) : library(names, path) {
    library.need("hdInitDevice", init_device);
    library.need("hdDisableDevice", disable_device);
    library.need("hdMakeCurrentDevice", make_current);
    library.need("hdBeginFrame", begin_frame);
    library.need("hdEndFrame", end_frame);
    library.need("hdGetIntegerv", get_integers);
    library.need("hdGetDoublev", get_doubles);
    library.need("hdSetDoublev", set_doubles);
    library.need("hdGetString", get_string);
    library.need("hdEnable", enable);
    library.need("hdDisable", disable);
    library.need("hdGetError", get_error);
    library.need("hdGetErrorString", error_string);
    library.need("hdCheckCalibration", check_calibration);
    library.need("hdUpdateCalibration", update_calibration);
    library.need("hdStartScheduler", start_scheduler);
    library.need("hdStopScheduler", stop_scheduler);
    library.need("hdScheduleAsynchronous", schedule);
    library.need("hdUnschedule", unschedule);
  }
};

}  // namespace hapticd::hd
