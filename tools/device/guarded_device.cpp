#include "tools/device/guarded_device.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "server/os/realtime.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr std::int64_t stale_ns = 5 * ms, lost_ns = 500 * ms;  // of a pose
constexpr std::int64_t hung_ns = 7 * ms, end_ns = 2000 * ms;   // without a write
constexpr std::int64_t hold_ns = 100 * ms;
constexpr timespec between_looks = {0, 500'000};
constexpr int watch_priority = 51;  // above the driver's thread, below Cyclone's

bool is_zero(const Feel& feel) noexcept {
  const auto none = [](double x) { return x == 0; };
  return std::all_of(feel.force.begin(), feel.force.end(), none) &&
         std::all_of(feel.torque.begin(), feel.torque.end(), none);
}

}  // namespace

GuardedDevice::GuardedDevice(VendorDevice& device, const GuardSettings& settings)
    : device_(device),
      settings_(settings),
      held_until_ns_(device_clock_ns() + hold_ns),
      watch_([this] { watch(); }) {}

GuardedDevice::~GuardedDevice() {
  device_.command({});
  device_.motors(false);
  stopping_.store(true);
  watch_.join();
}

bool GuardedDevice::read(Reading& reading) {
  Sample sample;
  if (!device_.sample(sample)) {
    device_.motors(false);
    fault_ = device_.fault();
    return false;
  }
  const std::int64_t now = device_clock_ns();
  if (cut_.exchange(false)) hold(now, report_.hung);
  if (now - sample.at_ns > lost_ns) {
    fault_ = "no new pose for 0.5 s";
    return false;
  }
  if (now - sample.at_ns > stale_ns)
    hold(now, report_.stale);
  else if (!sample.motors_on)
    hold(now, report_.switched_off);
  reading = sample.reading;
  if (const char* asks = device_.asks(); asks != asked_) {
    if (*asks) std::fprintf(stderr, "haptic device: no force yet: %s\n", asks);
    asked_ = asks;
  }
  if (*asked_) reading.enable = false;
  if (settings_.dead_man > 0 && !(reading.buttons >> (settings_.dead_man - 1) & 1)) reading.enable = false;
  if (now < held_until_ns_) reading.enable = false;
  return true;
}

void GuardedDevice::write(const Feel& feel) {
  const std::int64_t now = device_clock_ns();
  if (cut_.exchange(false)) hold(now, report_.hung);
  const bool held = now < held_until_ns_;
  const bool load = !held && !is_zero(feel);
  if (load) loaded_.store(true);
  if (!held && holding_) {
    device_.command({});
    device_.motors(true);
    holding_ = false;
  }
  device_.command(held ? Feel{} : feel);
  if (!load) loaded_.store(false);
  written_ns_.store(device_clock_ns());
}

// The count rises once a hold, not once a slot of it.
void GuardedDevice::hold(std::int64_t now_ns, std::uint64_t& count) noexcept {
  if (!holding_) {
    device_.motors(false);
    device_.command({});
    loaded_.store(false);
    ++count;
    holding_ = true;
  }
  held_until_ns_ = now_ns + hold_ns;
}

void GuardedDevice::watch() noexcept {
  name_thread("device-watch");
  use_fifo(watch_priority);
  bool off = false;
  while (!stopping_.load()) {
    nanosleep(&between_looks, nullptr);
    const std::int64_t written = written_ns_.load(), age = device_clock_ns() - written;
    if (written == 0) continue;
    if (age < hung_ns) {
      off = false;
    } else if (!off && loaded_.load()) {
      device_.motors(false);
      cut_.store(true);
      off = true;
    }
    if (age > end_ns) {
      std::fprintf(stderr, "haptic device: the maker's library has not returned for 2 s: motors off, the end\n");
      device_.motors(false);
      _exit(1);
    }
  }
}

}  // namespace hapticd
