// A device driver outside the source tree: it links hapticd::driver, and nothing of the simulation.
#include <cstdio>
#include <exception>

#include <tools/driver/driver.h>

struct Still final : hapticd::HapticDevice {
  bool read(hapticd::Reading&) override { return false; }  // no device: the driver ends
  void write(const hapticd::Feel&) override {}
};

int main() {
  Still device;
  try {
    hapticd::run_driver(device, {});
    return 1;  // a driver without a device's limits must not start
  } catch (const std::exception& refused) {
    std::printf("%s\n", refused.what());
  }
  std::printf("a driver of %zu bytes\n", sizeof device);
}
