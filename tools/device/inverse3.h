// Haply's Inverse3 through its Inverse service, a WebSocket of this machine that speaks JSON.
//
// Each force that is sent is answered with one state, so the pose is as old as the last answer. No more than
// two forces are ever unanswered, so that none is felt late behind others; zero always goes. A service
// that hears no force sets its device idle ("per-tick, non-persistent commands"), and so ends what a killed
// process leaves. There is no switch for the motors: off is zero, and while our own call hangs the connection
// is closed. Library: Boost.Beast, which `haptic view` has already. Force alone: the Inverse3 has no torque.
#pragma once

#include <memory>
#include <string>

#include "tools/device/vendor_device.h"

namespace hapticd {

struct Inverse3Address {
  std::string host = "127.0.0.1";
  std::string port = "10001";
};

// "PORT" or "HOST:PORT"; empty: the service's own default. Throws std::invalid_argument.
Inverse3Address inverse3_address(const std::string& text);

// device: its id as the service names it ("049D"); empty: the first.
std::unique_ptr<VendorDevice> open_inverse3(const Inverse3Address& address, const std::string& device);

}  // namespace hapticd
