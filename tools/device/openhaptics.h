// Devices of 3D Systems (Touch, Touch X, Omni, Premium) through HDAPI, the lower half of OpenHaptics.
//
// The maker's scheduler calls us 1000 times a second in its own thread; there, between hdBeginFrame and
// hdEndFrame, the pose is read and the newest force set, which takes it to the device one tick later at most.
// A force older than 8 ms is set to zero there, whatever the rest of the process does. Frame: HDAPI's base has
// x to the right, y up, z to the person (millimetres, column-major transform), its stylus z to the hand.
// Forces that the library refuses (too fast, too large, warm motors) are a pause, other errors the end.
// Source: OpenHaptics Toolkit API Reference (hdInitDevice … hdGetError), 3D Systems, v3.5. On torques: the
// Premium 6DOF takes gimbal torques in joint space, which this does not give; its torque is zero.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tools/device/vendor_device.h"

namespace hapticd {

// library: a path, or empty for the names that OpenHaptics has on Linux. device: as the maker's setup program
// names it ("Default Device"); empty: the default one.
std::unique_ptr<VendorDevice> open_openhaptics(const std::string& library, const std::string& device);

const std::vector<std::string>& openhaptics_libraries();

}  // namespace hapticd
