// A haptic device on hapticd: say how to read it and how to write it, and run.
//
//   every 1 ms:  read → send → wait for the answer until the millisecond is over → write
//
// The library does stamps and numbers. It arms, and arms again after a silence; after a latch you must send
// `enable` false, then true. It ignores forces that answer another client and forces of a second daemon.
// Each force is within the device's limits, in size and in change. The force goes to zero within the slew
// limit and stays there while a second daemon is heard. It is zero at once when none has come for 7 ms or
// one is not finite, and zero is the last thing written when the run ends: by a signal, a failing device, an
// exception of yours, exit(), an abort or a crash in any thread (ending.h). After SIGKILL the last force
// stands in the device, and its own electronics must drop it. Units: m, N, N·m. The device frame is the
// device's own; the scene maps it (config/README.md, `mapping`). Threads: read and write are called on the
// thread that calls run_driver; after a crash in another thread `write` may be called on that one.
// Guarantee: no allocation of its own between two slots; SCHED_FIFO where it is granted. Errors: run_driver
// throws std::invalid_argument (no device named), InputError (its file, keys), std::runtime_error (DDS), and
// what read or write throw.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "tools/client_library/feel.h"

namespace hapticd {

class HapticDevice {
 public:
  virtual ~HapticDevice() = default;
  virtual bool read(Reading& reading) = 0;  // false: the device is lost, the run ends
  virtual void write(const Feel& feel) = 0;
};

struct DriverOptions {
  // Whose limits hold: a name of config/devices ("touch"), or a file like those. Required.
  std::string device;
  std::uint32_t domain = 0;
  std::uint32_t device_id = 0;
  std::filesystem::path keys;  // of a daemon with --secure; empty: none
  bool open_network =
      false;            // a profile that names an interface is used without keys: whoever is there is trusted
  std::string station;  // the daemon's --station; empty: none
  double duration = 0;  // [s]; 0: until a signal
  bool realtime = true;  // ask for SCHED_FIFO 50
};

struct DriverReport {
  std::uint64_t sent = 0, answered = 0;  // states
  std::uint64_t silences = 0;            // times that no force had come for 10 ms, after the first one
  std::string place;                     // DDS domain and profile, to say where nobody answered
  double longest_silence_ms = 0;
  std::uint64_t strange_forces = 0;  // of a second daemon for this device: not felt
  std::string realtime_refused;      // empty: granted, or not asked for
  enum class End { signal, device_lost, duration } end = End::signal;
};

DriverReport run_driver(HapticDevice& device, const DriverOptions& options);

}  // namespace hapticd
