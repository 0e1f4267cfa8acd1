// A device that is none: what a fake of a maker's library and a test share, in a file that both map.
//
// The test sets pose and faults; the fake writes down every force and every switch of the motors, with its own
// time. In the maker's units and axes. Thread safety: all of it is atomic or written before the process starts.
#pragma once

#include <fcntl.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <new>
#include <stdexcept>
#include <string>

namespace hapticd {

struct FakeDevice {
  enum Fault : int {
    none,
    unplugged,    // every call fails from now on
    call_fails,   // one call, reading the pose, does
    force_fails,  // setting a force does
    hangs,        // reading the pose does not return
    slow,         // a pose comes every 50 ms only
    refused       // the library refuses the force, once
  };
  struct Event {
    std::int64_t at_ns;
    std::array<double, 3> force;
    bool motors;
    double felt() const { return motors ? std::hypot(force[0], force[1], force[2]) : 0; }
  };

  // The test's.
  std::atomic<int> fault{none};
  std::array<std::atomic<double>, 3> position{};
  std::array<std::array<double, 3>, 3> rotation{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  std::atomic<unsigned> buttons{0};
  std::atomic<bool> calibrated{true}, person_switched_off{false}, has_watchdog{true};
  // The fake's.
  std::atomic<bool> motors{false};
  std::atomic<int> open{0}, watchdog{0}, updates_of_calibration{0};
  std::array<std::atomic<double>, 3> force{};
  std::atomic<std::uint32_t> events{0};
  std::array<Event, 1 << 15> event;

  static std::int64_t now_ns() {
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1'000'000'000 * t.tv_sec + t.tv_nsec;
  }
  void note() {
    const std::uint32_t i = events.fetch_add(1);
    if (i < event.size()) event[i] = {now_ns(), {force[0], force[1], force[2]}, motors};
  }
  void set_force(double x, double y, double z) {
    force[0] = x;
    force[1] = y;
    force[2] = z;
    note();
  }
  void set_motors(bool on) {
    motors = on;
    note();
  }
};

// The fakes of libHD and libdhd, as the tests' own build has them.
#ifdef BIN_DIR
inline const char* const fake_openhaptics = BIN_DIR "/../tests/libfake_openhaptics.so";
inline const char* const fake_force_dimension = BIN_DIR "/../tests/libfake_force_dimension.so";
#endif

// The one of the file that FAKE_DEVICE names.
inline FakeDevice& fake_device(bool fresh = false) {
  static FakeDevice* shared = nullptr;
  static std::string mapped;
  const char* name = std::getenv("FAKE_DEVICE");
  if (shared && !fresh && name && mapped == name) return *shared;
  const int file = name ? open(name, O_RDWR | O_CREAT, 0600) : -1;
  if (file < 0 || ftruncate(file, sizeof(FakeDevice)) != 0) throw std::runtime_error("FAKE_DEVICE: no such file");
  void* memory = mmap(nullptr, sizeof(FakeDevice), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  close(file);
  if (memory == MAP_FAILED) throw std::runtime_error("FAKE_DEVICE: not mapped");
  mapped = name;
  shared = fresh ? new (memory) FakeDevice : static_cast<FakeDevice*>(memory);
  return *shared;
}

inline void fake_sleep(std::int64_t ns) {
  const timespec t{ns / 1'000'000'000, ns % 1'000'000'000};
  nanosleep(&t, nullptr);
}

}  // namespace hapticd
