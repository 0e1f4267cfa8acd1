#include "tools/cli/child.h"

#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <sstream>
#include <stdexcept>

namespace hapticd {
namespace {

// Between vfork and exec, in the owner's memory: only what is async-signal-safe and writes nothing that lasts.
[[noreturn]] void become(const ChildSettings& s, char* const* argv, char* const* environment, pid_t owner) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != owner) _exit(127);
  if (s.fifo_priority > 0) {
    const sched_param param{s.fifo_priority};
    sched_setscheduler(0, SCHED_FIFO, &param);
  }
  if (s.core) {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(*s.core, &set);
    sched_setaffinity(0, sizeof set, &set);
  }
  const int in = open("/dev/null", O_RDONLY);
  const int out = open(s.output.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  dup2(in, 0);
  dup2(out, 1);
  dup2(out, 2);
  signal(SIGINT, SIG_IGN);  // a Ctrl-C is for the owner, who ends its children in order
  execvpe(argv[0], argv, environment);
  _exit(127);
}

std::vector<char*> pointers(const std::vector<std::string>& words) {
  std::vector<char*> result;
  for (const std::string& word : words) result.push_back(const_cast<char*>(word.c_str()));
  result.push_back(nullptr);
  return result;
}

}  // namespace

Child::Child(const ChildSettings& settings) {
  std::vector<std::string> environment = settings.environment;
  for (char** e = environ; *e; ++e) environment.emplace_back(*e);
  const std::vector<char*> argv = pointers(settings.command), env = pointers(environment);
  const pid_t owner = getpid();
  // fork would copy the page tables and hold every real-time thread of the owner that touches a page meanwhile,
  // for 5 to 50 ms on a busy machine.
  const pid_t child = vfork();
  if (child == 0) become(settings, argv.data(), env.data(), owner);
  if (child < 0) throw std::runtime_error("cannot start " + settings.command.front());
  pid_ = child;
}

Child::~Child() {
  if (!running()) return;
  signal(SIGKILL);
  wait(5);
}

bool Child::running() noexcept {
  if (code_) return false;
  int status = 0;
  if (waitpid(pid_, &status, WNOHANG) != pid_) return true;
  code_ = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  return false;
}

void Child::signal(int number) const noexcept {
  if (!code_) kill(pid_, number);
}

void Child::signal(int number, int value) const noexcept {
  sigval v{};
  v.sival_int = value;
  if (!code_) sigqueue(pid_, number, v);
}

std::optional<int> Child::wait(double seconds) noexcept {
  for (int i = 0; running() && i < static_cast<int>(1e3 * seconds); ++i) usleep(1000);
  return code_;
}

std::string beside_this_program(const std::string& name) {
  return (std::filesystem::read_symlink("/proc/self/exe").parent_path() / name).string();
}

bool is_installed(const std::string& name) {
  std::istringstream path(getenv("PATH") ? getenv("PATH") : "/usr/bin");
  for (std::string folder; std::getline(path, folder, ':');)
    if (access((folder + "/" + name).c_str(), X_OK) == 0) return true;
  return false;
}

}  // namespace hapticd
