// Cyclone DDS's warnings and errors as lines of the daemon's own log (events `dds` and `packets_refused`).
//
// Cyclone logs from its receive thread, which is real-time, and packets of strangers decide how often. So
// its lines go into a bounded queue without locks; when that is full they are dropped and counted. The
// diagnostics thread writes them: at most `dds_lines_per_period` in ten seconds, the rest as a number.
// Traces that a profile asks for go to the file that the profile names.
// Thread safety: note_dds_line may be called from any thread, real-time ones too (no lock, no allocation).
// The other functions are for one thread at a time; a second caller returns at once. Errors: none.
#pragma once

#include <cstdint>
#include <string_view>

#include "server/observe/log.h"

namespace hapticd {

inline constexpr int dds_lines_per_period = 10;
inline constexpr std::int64_t dds_period_ns = 10'000'000'000;

void take_dds_log() noexcept;  // from now on
void note_dds_line(LogLevel level, std::uint32_t domain, std::string_view text) noexcept;
void write_dds_log(std::int64_t now_ns) noexcept;
void write_whole_dds_log() noexcept;  // before the process ends, since these lines may say why
std::uint64_t dds_lines() noexcept;   // all lines of Cyclone so far, written or not

}  // namespace hapticd
