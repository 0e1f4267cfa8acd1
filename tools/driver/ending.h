// Writes zero to the device before the driver's process ends.
//
//   SIGINT, SIGTERM, SIGHUP        asked() is true from then on, and the run ends by itself
//   SIGABRT (std::terminate, an assertion, a library), SIGSEGV, SIGBUS, SIGFPE, SIGILL, exit()
//     in the driver's thread       zero is written at once
//     in another thread            the run is asked to end; after 10 ms zero is written in its place
//
// If the device's write hangs then, the signal ends the process after a second, after exit() SIGALRM does.
// SIGKILL leaves the last force.
// Thread safety: made, told `at_zero` and destroyed by the thread that writes; one at a time in a process.
#pragma once

#include <csignal>

#include "tools/driver/driver.h"

namespace hapticd {

class Ending {
 public:
  explicit Ending(HapticDevice& device);
  ~Ending();  // gives the handlers back
  Ending(const Ending&) = delete;
  Ending& operator=(const Ending&) = delete;

  bool asked() const noexcept;
  // Zero was written, and nothing will be written behind it.
  void at_zero() noexcept;
};

}  // namespace hapticd
