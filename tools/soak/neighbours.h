// Real-time threads of other programs that may run on a core: a second daemon that was left running, audio, a
// robot's controller. They make a loop late, and a soak that does not name them blames the wrong one.
//
// Kernel threads are no programs and are left out. Errors: none; what cannot be read is not there.
#pragma once

#include <sys/types.h>

#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

namespace hapticd {

struct Neighbour {
  pid_t pid = 0;
  std::string program;
  int priority = 0;  // highest of its real-time threads that may use the core
};

// Without the programs `own`, and this one. By process number.
std::vector<Neighbour> realtime_neighbours(int core, const std::set<pid_t>& own = {});

// [{"pid", "program", "priority"}, …]; "hapticd (process 12, priority 80), …"
nlohmann::ordered_json to_json(const std::vector<Neighbour>& neighbours);
std::string to_text(const std::vector<Neighbour>& neighbours);

}  // namespace hapticd
