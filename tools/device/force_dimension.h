// Devices of Force Dimension (omega, delta, sigma, lambda) and the Novint Falcon through the DHD library.
//
// Pose and force are calls in the driver's own thread. Besides the guard's, the device has a watchdog in its
// firmware: 8 ms without a force, and it switches its motors off (dhdSetWatchdog, where library and device
// have it), so that even a killed process leaves none. Frame: DHD's base has x to the person, y to the right,
// z up (metres); the handle's shaft is taken to be x of its end effector, which is the house's at rest. A
// gripper that closes presses button 0 (dhdEmulateButton). Motors that the person's force button or its dead
// man's sensor switched off stay so until that switches them on. Source: Force Dimension SDK documentation
// (DHD), 3.3 to 3.17.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tools/device/vendor_device.h"

namespace hapticd {

// device: number among those connected ("0", "1", …); empty: the first that is free. falcon: refuse any other,
// or only that.
std::unique_ptr<VendorDevice> open_force_dimension(const std::string& library, const std::string& device,
                                                   bool falcon);

const std::vector<std::string>& force_dimension_libraries();
int force_dimension_count(const std::string& library);  // devices connected

}  // namespace hapticd
