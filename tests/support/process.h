// A program run as a process of its own; killed with its owner.
#pragma once

#include <csignal>
#include <string>
#include <vector>

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

namespace hapticd {

class ChildProcess {
 public:
  // output: file for stdout and stderr.
  explicit ChildProcess(const std::vector<std::string>& command, const std::string& output = "/dev/null") {
    pid_ = fork();
    if (pid_ != 0) return;
    dup2(open("/dev/null", O_RDONLY), 0);
    const int out = open(output.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dup2(out, 1);
    dup2(out, 2);
    std::vector<char*> argv;
    for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
    argv.push_back(nullptr);
    execv(argv[0], argv.data());
    _exit(127);
  }
  ~ChildProcess() {
    signal(SIGKILL);
    wait(2000);
  }
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  pid_t pid() const { return pid_; }
  void signal(int number) const {
    if (pid_ > 0) kill(pid_, number);
  }
  // Exit code, −signal, or 1000 when it did not end in time.
  int wait(int timeout_ms) {
    for (int i = 0; pid_ > 0 && i < timeout_ms; ++i) {
      int status = 0;
      if (waitpid(pid_, &status, WNOHANG) == pid_) {
        pid_ = 0;
        code_ = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
      } else {
        usleep(1000);
      }
    }
    return code_;
  }

 private:
  pid_t pid_ = 0;
  int code_ = 1000;
};

}  // namespace hapticd
