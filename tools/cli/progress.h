// One line of progress on a terminal, and nothing anywhere else.
//
// Drawn on stderr, at most ten times a second, and only where stderr is a terminal; a run shorter than two
// seconds draws nothing. Owned and called by one thread.
#pragma once

#include <chrono>
#include <string>

namespace hapticd {

class Progress {
 public:
  explicit Progress(std::string what);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // fraction in [0, 1]; detail: a few words.
  void show(double fraction, const std::string& detail);

 private:
  std::string what_;
  std::chrono::steady_clock::time_point start_, last_;
  bool terminal_;
  bool drawn_ = false;
};

}  // namespace hapticd
