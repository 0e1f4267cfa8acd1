// A haptic device behind its maker's library or service, as few calls as a driver needs.
//
//   sample    the newest pose, in the house frame (frames.h), and when it was read
//   command   force and torque from now on, in the house frame
//   motors    on or off by the maker's own switch, which outlasts a command that is still under way
//
// Units: m, N, N·m, ns (CLOCK_MONOTONIC). Errors: making one throws std::runtime_error; afterwards `sample`
// returns false where the device is lost for good, and `fault` says why. Threads: all calls come from the
// thread that made it, except `motors(false)`, which any thread may call while another call hangs, and
// `command({})`, which a dying thread calls. A device that is destroyed has its motors off.
#pragma once

#include <time.h>

#include <cstdint>
#include <string>

#include "tools/driver/driver.h"

namespace hapticd {

struct Sample {
  Reading reading;
  std::int64_t at_ns = 0;  // when the device, not we, read it
  bool motors_on = true;   // false: the maker's electronics or library switched them off by itself
};

class VendorDevice {
 public:
  virtual ~VendorDevice() = default;
  virtual bool sample(Sample& sample) noexcept = 0;
  virtual void command(const Feel& feel) noexcept = 0;
  virtual void motors(bool on) noexcept = 0;
  virtual std::string name() const = 0;   // as the maker names it, with serial number and side where known
  virtual std::string fault() const = 0;  // the maker's words for it, with the call that failed
  // What a person has to do before force is given ("put the stylus into its inkwell"); empty: nothing.
  virtual const char* asks() const noexcept = 0;
};

inline std::int64_t device_clock_ns() noexcept {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1'000'000'000 * t.tv_sec + t.tv_nsec;
}

}  // namespace hapticd
