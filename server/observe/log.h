// The daemon's log: one line an event, for a person or for a program.
//
//   human   hapticd: ready, domain 0
//   json    {"time":"2026-01-31T12:00:00.000Z","level":"info","event":"ready","message":"ready, domain 0",…}
//
// A line is one write to stderr. No line waits for its reader: into a full pipe it is lost and counted, and
// the next line that can be written is followed by one that says how many were lost.
// Thread safety: any ordinary thread. A real-time thread has called `no_log_from_this_thread` first: its
// lines are dropped and counted. Errors: none.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace hapticd {

enum class LogLevel { debug, info, warning, error };
enum class LogFormat { human, json };

using LogFields = nlohmann::ordered_json;  // an object; its keys follow the message's

const char* to_string(LogLevel level) noexcept;
std::optional<LogLevel> log_level(const std::string& name);

// One line without its end. time_ns: since 1970, UTC.
std::string log_line(LogFormat format, LogLevel level, std::int64_t time_ns, const std::string& event,
                     const std::string& message, const LogFields& fields);

void set_log_format(LogFormat format) noexcept;
void set_log_level(LogLevel level) noexcept;  // what is below is not written; info at first
LogLevel log_level_now() noexcept;

void log(LogLevel level, const std::string& event, const std::string& message,
         const LogFields& fields = LogFields::object()) noexcept;

void no_log_from_this_thread() noexcept;
std::uint64_t lines_refused() noexcept;
std::uint64_t lines_lost() noexcept;

}  // namespace hapticd
