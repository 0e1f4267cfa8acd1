// What may end a driver's process, and the zero that its device feels before it does.
//
//   SIGINT, SIGTERM, SIGHUP                  asked() is true from then on, and the run ends by itself
//   SIGABRT (std::terminate, an assertion, a library that gives up), SIGSEGV, SIGBUS, SIGFPE, SIGILL, exit()
//     in the driver's thread                 zero is written at once
//     in another thread                      the run is asked to end; after 10 ms zero is written in its
//     place
//
// A process whose device's write hangs then is ended by SIGALRM after a second. SIGKILL leaves what stands.
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
