#include "tools/cli/progress.h"

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
  constexpr std::size_t width = 30;
  const auto filled = static_cast<std::size_t>(width * std::clamp(fraction, 0.0, 1.0));
  const std::string bar = std::string(filled, '#') + std::string(width - filled, '.');
  std::fprintf(stderr, "\r\033[K%s [%s] %3.0f %%  %s", what_.c_str(), bar.c_str(), 100 * fraction,
               detail.c_str());
  std::fflush(stderr);
}

}  // namespace hapticd
