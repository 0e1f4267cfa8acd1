#include "tools/soak/neighbours.h"

#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <fstream>

namespace hapticd {
namespace {

namespace fs = std::filesystem;

// The numbers that name entries of a folder in /proc.
std::vector<pid_t> numbers_in(const fs::path& folder) {
  std::vector<pid_t> numbers;
  std::error_code error;
  for (fs::directory_iterator i(folder, error), end; !error && i != end; i.increment(error)) {
    const std::string name = i->path().filename();
    pid_t number = 0;
    const auto [rest, failed] = std::from_chars(name.data(), name.data() + name.size(), number);
    if (failed == std::errc() && rest == name.data() + name.size()) numbers.push_back(number);
  }
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

std::string first_line(const fs::path& file) {
  std::string line;
  std::ifstream in(file);
  std::getline(in, line);
  return line;
}

// Its real-time priority if it may use the core, else 0.
int priority_on(int core, pid_t thread) {
  const int policy = sched_getscheduler(thread);
  cpu_set_t cores;
  sched_param parameters{};
  if ((policy != SCHED_FIFO && policy != SCHED_RR) || sched_getparam(thread, &parameters) != 0 ||
      sched_getaffinity(thread, sizeof cores, &cores) != 0 || !CPU_ISSET(core, &cores))
    return 0;
  return parameters.sched_priority;
}

}  // namespace

std::vector<Neighbour> realtime_neighbours(int core, const std::set<pid_t>& own) {
  std::vector<Neighbour> found;
  for (const pid_t pid : numbers_in("/proc")) {
    if (pid == getpid() || own.count(pid) > 0) continue;
    const fs::path folder = fs::path("/proc") / std::to_string(pid);
    if (first_line(folder / "cmdline").empty()) continue;  // a kernel thread
    Neighbour n{pid, first_line(folder / "comm")};
    for (const pid_t thread : numbers_in(folder / "task"))
      n.priority = std::max(n.priority, priority_on(core, thread));
    if (n.priority > 0) found.push_back(n);
  }
  return found;
}

nlohmann::ordered_json to_json(const std::vector<Neighbour>& neighbours) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const Neighbour& n : neighbours)
    list.push_back({{"pid", n.pid}, {"program", n.program}, {"priority", n.priority}});
  return list;
}

std::string to_text(const std::vector<Neighbour>& neighbours) {
  std::string text;
  for (const Neighbour& n : neighbours)
    text += (text.empty() ? "" : ", ") + n.program + " (process " + std::to_string(n.pid) + ", priority " +
            std::to_string(n.priority) + ")";
  return text;
}

}  // namespace hapticd
