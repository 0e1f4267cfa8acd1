// Of functions that are not for signal handlers, snprintf and backtrace allocate nothing once the latter has
// run: its library is loaded by the first call, at start-up.
#include "server/os/crash_report.h"

#include <execinfo.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>

namespace hapticd {
namespace {

constexpr int most_calls = 64;

void report(int number) noexcept {
  std::array<char, 16> thread{};
  prctl(PR_GET_NAME, thread.data());
  std::array<char, 128> text;
  const int length = std::snprintf(
      text.data(), text.size(), "crashed: signal %d in thread '%s', called from:\n", number, thread.data());
  if (write(STDERR_FILENO, text.data(), static_cast<std::size_t>(std::max(0, length))) < 0) return;
  std::array<void*, most_calls> calls;
  backtrace_symbols_fd(calls.data(), backtrace(calls.data(), most_calls), STDERR_FILENO);
}

void report_and_crash(int number) noexcept {
  std::signal(number, SIG_DFL);
  report(number);
  std::raise(number);
}

}  // namespace

void report_crashes() noexcept {
  std::array<void*, 1> loaded;
  backtrace(loaded.data(), 1);
  for (const int number : {SIGSEGV, SIGBUS, SIGILL, SIGFPE, SIGABRT}) std::signal(number, report_and_crash);
}

}  // namespace hapticd
