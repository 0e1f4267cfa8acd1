// A device driver in forty lines: example_driver [DOMAIN] [KEYS]. Put your SDK where the sine is.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "tools/driver/driver.h"

// Stands for the device: its tip goes from 30.5 mm down to 21.5 mm and back, every four seconds.
class SineDevice final : public hapticd::HapticDevice {
 public:
  bool read(hapticd::Reading& reading) override {  // your SDK: the pose, in metres
    reading.position = {0, 0, 0.026 + 0.0045 * std::cos(2 * M_PI * 1e-3 * ticks_++ / 4)};
    return true;
  }
  void write(const hapticd::Feel& feel) override {  // your SDK: the motors, in newtons
    newest_ = std::hypot(feel.force[0], feel.force[1], feel.force[2]);
    peak_ = std::fmax(peak_, newest_);
  }
  double newest() const { return newest_; }
  double peak() const { return peak_; }

 private:
  int ticks_ = 0;
  double newest_ = 0, peak_ = 0;
};

int main(int argc, char** argv) try {
  SineDevice device;
  hapticd::DriverOptions options;
  options.device = "touch";  // your device's limits: a file of config/devices, or one like it
  char* end = nullptr;
  if (argc > 1) options.domain = static_cast<std::uint32_t>(std::strtoul(argv[1], &end, 10));
  if (argc > 2) options.keys = argv[2];
  if (argc > 3) options.station = argv[3];
  if (argc > 4 || (end && (end == argv[1] || *end != '\0'))) {
    std::fprintf(stderr, "Usage: example_driver [DOMAIN [KEYS [STATION]]]\n");
    return 2;
  }
  std::fprintf(stderr, "presses into the daemon of DDS domain %u, now or when one comes; Ctrl-C ends\n",
               options.domain);
  const hapticd::DriverReport report = hapticd::run_driver(device, options);
  std::printf("%llu states sent, %llu answered, %.1f ms without a force at most\n",
              static_cast<unsigned long long>(report.sent), static_cast<unsigned long long>(report.answered),
              report.longest_silence_ms);
  if (report.answered == 0)
    std::fprintf(stderr, "example_driver: no daemon answered in %s\n", report.place.c_str());
  std::printf("peak force %.4f N, last force written %.4f N\n", device.peak(), device.newest());
  if (report.strange_forces > 0) std::printf("a second daemon wrote forces for this device: none was felt\n");
} catch (const std::exception& error) {
  std::fprintf(stderr, "example_driver: %s\n", error.what());
  return 1;
}
