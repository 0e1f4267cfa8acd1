// What happened in the loops and deserves a line: found in their counters, never said by them.
//
// Pure: two looks at a device's counters make the lines between them. A kind of warning comes at most once in
// ten seconds, with the number since its last one; a device that is armed or let go is always said. Thread
// safety: one thread.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <vector>

#include "server/observe/log.h"

namespace hapticd {

struct LoopCounters {
  std::uint32_t device_id = 0;
  std::uint32_t status = 1;  // of the newest force; bit 0: disarmed (haptic/device.h)
  bool silent = false;       // … because no state of its client came
  std::uint64_t deadline_misses = 0, missed = 0, refused = 0, conflicts = 0, solver_caps = 0,
                contacts_dropped = 0;
  std::uint64_t overruns = 0, references_failed = 0, recording_dropped = 0;
};

struct Incident {
  LogLevel level;
  std::string event, message;
  LogFields fields;
};

class Incidents {
 public:
  std::vector<Incident> look(std::int64_t now_ns, const LoopCounters& counters);

 private:
  struct Kind {
    std::uint64_t said = 0;
    std::int64_t said_ns = 0;
    bool ever = false;
  };
  struct Device {
    LoopCounters last;
    std::array<Kind, 8> kinds;
  };
  std::map<std::uint32_t, Device> devices_;
};

}  // namespace hapticd
