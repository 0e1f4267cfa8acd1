// Runs the built `haptic` as a person would, and returns what came of it.
#pragma once

#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

#include "server/os/realtime.h"

namespace hapticd {

// Of the states sent, how many must be answered while others load the machine. Without SCHED_FIFO a fair
// scheduler shares two cores among the daemon, the client and those who disturb them.
inline double answered_share() { return realtime_allowed() ? 0.9 : 0.5; }

struct CommandResult {
  int code = -1;
  std::string output;  // stdout and stderr
};

inline CommandResult run_command(const std::string& command) {
  FILE* pipe = popen((command + " </dev/null 2>&1").c_str(), "r");
  if (!pipe) throw std::runtime_error("popen failed");
  CommandResult result;
  std::array<char, 4096> part;
  for (std::size_t n; (n = fread(part.data(), 1, part.size(), pipe)) > 0;)
    result.output.append(part.data(), n);
  const int status = pclose(pipe);
  result.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return result;
}

inline CommandResult run_haptic(const std::string& arguments) {
  return run_command(BIN_DIR "/haptic " + arguments);
}

// A directory of its own that is gone with the object.
class ScratchDirectory {
 public:
  ScratchDirectory() {
    std::string name = (std::filesystem::temp_directory_path() / "hapticd-tools-XXXXXX").string();
    if (!mkdtemp(name.data())) throw std::runtime_error("mkdtemp failed");
    path_ = name;
  }
  ~ScratchDirectory() { std::filesystem::remove_all(path_); }
  std::string file(const std::string& name, const std::string& content = "") const {
    const std::string path = (path_ / name).string();
    if (!content.empty()) std::ofstream(path) << content;
    return path;
  }

 private:
  std::filesystem::path path_;
};

}  // namespace hapticd
