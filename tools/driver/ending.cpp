#include "tools/driver/ending.h"

#include <time.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdlib>

namespace hapticd {
namespace {

constexpr std::array<int, 3> polite = {SIGINT, SIGTERM, SIGHUP};
constexpr std::array<int, 5> crashes = {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL};
constexpr int patience = 100;                     // looks at whether the driver's thread has written zero …
constexpr timespec between_looks = {0, 100'000};  // … and the time between two

std::array<struct sigaction, polite.size()> polite_before;
std::array<struct sigaction, crashes.size()> crashes_before;
std::atomic<HapticDevice*> device_at_work{nullptr};
std::atomic<pid_t> driver_thread{0};
std::atomic<bool> asked_to_end{false};
std::atomic<int> crash{SIGALRM};  // what ends the process, if its last write hangs
static_assert(std::atomic<HapticDevice*>::is_always_lock_free && std::atomic<pid_t>::is_always_lock_free &&
              std::atomic<bool>::is_always_lock_free && std::atomic<int>::is_always_lock_free);

// The write hangs: the process ends by the signal that it would have ended by.
void on_hang(int) {
  const int number = crash.load();
  sigset_t alone;
  sigemptyset(&alone);
  sigaddset(&alone, number);
  signal(number, SIG_DFL);
  raise(number);
  pthread_sigmask(SIG_UNBLOCK, &alone, nullptr);
}

void write_last_zero() noexcept {
  asked_to_end.store(true);
  if (gettid() != driver_thread.load())
    for (int i = 0; i < patience && device_at_work.load(); ++i) nanosleep(&between_looks, nullptr);
  HapticDevice* device = device_at_work.exchange(nullptr);
  if (!device) return;
  // Whoever wrote may have held a lock of the device's when it died.
  signal(SIGALRM, on_hang);
  alarm(1);
  try {
    device->write({});
  } catch (...) {  // the process ends for another reason, which is the one to tell
  }
  alarm(0);
}

void on_polite_signal(int) { asked_to_end.store(true); }

// Once: the second one, or the same again when this returns, is answered as it was before the driver.
void on_crash(int number) {
  const int error = errno;
  for (std::size_t i = 0; i < crashes.size(); ++i) sigaction(crashes[i], &crashes_before[i], nullptr);
  crash.store(number);
  write_last_zero();
  errno = error;
  raise(number);
}

}  // namespace

Ending::Ending(HapticDevice& device) {
  static const bool registered = std::atexit(write_last_zero) == 0;
  static_cast<void>(registered);
  asked_to_end.store(false);
  driver_thread.store(gettid());
  device_at_work.store(&device);
  struct sigaction action {};
  action.sa_handler = on_polite_signal;
  for (std::size_t i = 0; i < polite.size(); ++i) sigaction(polite[i], &action, &polite_before[i]);
  action.sa_handler = on_crash;
  for (std::size_t i = 0; i < crashes.size(); ++i) sigaction(crashes[i], &action, &crashes_before[i]);
}

Ending::~Ending() {
  device_at_work.store(nullptr);
  for (std::size_t i = 0; i < polite.size(); ++i) sigaction(polite[i], &polite_before[i], nullptr);
  for (std::size_t i = 0; i < crashes.size(); ++i) sigaction(crashes[i], &crashes_before[i], nullptr);
}

bool Ending::asked() const noexcept { return asked_to_end.load(std::memory_order_relaxed); }

void Ending::at_zero() noexcept { device_at_work.store(nullptr); }

}  // namespace hapticd
