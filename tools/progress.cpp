#include "tools/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <utility>

namespace hapticd {

using namespace std::chrono_literals;

Progress::Progress(std::string what)
    : what_(std::move(what)),
      start_(std::chrono::steady_clock::now()),
      last_(start_),
      terminal_(isatty(STDERR_FILENO) == 1) {}

Progress::~Progress() {
  if (drawn_) std::fputs("\r\033[K", stderr);
}

void Progress::show(double fraction, const std::string& detail) {
  const auto now = std::chrono::steady_clock::now();
  if (!terminal_ || now - last_ < 100ms) return;
  const double elapsed = std::chrono::duration<double>(now - start_).count();
  const bool short_run = fraction > 0 && elapsed / fraction < 2;
  if (short_run) return;
  last_ = now;
  drawn_ = true;
  constexpr int width = 30;
  const int filled = static_cast<int>(width * std::clamp(fraction, 0.0, 1.0));
  std::fprintf(stderr, "\r\033[K%s [%s%s] %3.0f %%  %s", what_.c_str(), std::string(static_cast<std::size_t>(filled), '#').c_str(),
               std::string(static_cast<std::size_t>(width - filled), '.').c_str(), 100 * fraction, detail.c_str());
  std::fflush(stderr);
}

}  // namespace hapticd
