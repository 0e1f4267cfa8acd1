// A daemon of a soak's own: started, stopped while somebody else is measured, asked for its figures.
//
// Errors: the constructor and `summary` throw std::runtime_error with the daemon's own output.
// Thread safety: one thread.
#pragma once

#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "tools/cli/child.h"

namespace hapticd {

// One device's figures in a daemon's summary, which has the first one's at the top. Throws std::runtime_error
// where there is no such device.
const nlohmann::json& device_summary(const nlohmann::json& summary, std::uint32_t device);

class SoakDaemon {
 public:
  // Returns when it is ready, and stopped.
  SoakDaemon(const std::string& scene, const std::string& mode, std::uint32_t domain,
             const std::filesystem::path& scratch);
  ~SoakDaemon();

  void stop() { child_.signal(SIGSTOP); }
  void go_on() { child_.signal(SIGCONT); }
  std::uint32_t domain() const { return domain_; }
  pid_t pid() const { return child_.pid(); }

  // Its summary so far, histograms since its start.
  nlohmann::json summary();
  const nlohmann::json& last() const { return last_; }
  double resident_mb() const { return last_.at("rss_mb").get<double>(); }

 private:
  bool ready() const;

  std::uint32_t domain_;
  std::filesystem::path figures_, log_;
  Child child_;
  nlohmann::json last_;
};

}  // namespace hapticd
