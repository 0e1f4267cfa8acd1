// A program run beside this one: started with a priority and a core, stopped, continued, and gone with its
// owner.
//
// Its output goes to a file. It also ends when this process dies, however that happens.
// Thread safety: one thread. Errors: the constructor throws std::runtime_error when nothing can be started;
// a program that is not there shows as exit code 127.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <vector>

namespace hapticd {

struct ChildSettings {
  std::vector<std::string> command;  // first: a path, or a name looked up in PATH
  std::string output = "/dev/null";
  std::vector<std::string> environment = {};  // NAME=VALUE, added
  int fifo_priority = 0;                      // 0: ordinary; ordinary as well where it is refused
  std::optional<int> core = {};
};

class Child {
 public:
  explicit Child(const ChildSettings& settings);
  ~Child();  // SIGKILL if it still runs
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  pid_t pid() const noexcept { return pid_; }
  bool running() noexcept;
  void signal(int number) const noexcept;
  void signal(int number, int value) const noexcept;  // with a value, for real-time signals
  // Exit code, −signal, or nothing when it still runs after that time.
  std::optional<int> wait(double seconds) noexcept;

 private:
  pid_t pid_ = 0;
  std::optional<int> code_;
};

// The program `name` that lies beside this one.
std::string beside_this_program(const std::string& name);

// Whether a program of that name is in PATH.
bool is_installed(const std::string& name);

}  // namespace hapticd
