// Recording of the haptic loop, one CSV line per tick.
//
// Columns, with a header line: t (s since the first line), tick, echo (state's number), p* and q*
// (device frame), buttons, ix iy iz (instrument in the scene), f* and t* (device frame, N and N·m),
// status, step, state_age_us, problem_age_ms, wake_us, solve_us, contacts, active, penetration_um,
// energy_j. `haptic replay` reads t, p*, q* and buttons of it back.
// Errors: the constructor throws std::runtime_error naming the file; a full disk shows in failed().
#pragma once

#include <filesystem>
#include <fstream>

#include "haptic/loop.h"

namespace hapticd {

class ForceRecordWriter {
 public:
  explicit ForceRecordWriter(const std::filesystem::path& file);
  void write(const ForceRecord& record);
  void flush() { out_.flush(); }
  bool failed() const { return !out_; }

 private:
  std::ofstream out_;
  std::int64_t first_ns_ = 0;
};

}  // namespace hapticd
