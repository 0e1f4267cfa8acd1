#include "tools/soak/soak_daemon.h"

#include <unistd.h>

#include <fstream>
#include <iterator>
#include <stdexcept>

namespace hapticd {
namespace {

std::string text_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

const nlohmann::json& device_summary(const nlohmann::json& summary, std::uint32_t device) {
  if (summary.at("device_id") == device) return summary;
  if (summary.contains("more_devices"))
    for (const nlohmann::json& other : summary.at("more_devices"))
      if (other.at("device_id") == device) return other;
  throw std::runtime_error("hapticd gave no figures of device " + std::to_string(device));
}

SoakDaemon::SoakDaemon(const std::string& scene, const std::string& mode, std::uint32_t domain,
                       const std::filesystem::path& scratch)
    : domain_(domain),
      figures_(scratch / ("hapticd_" + mode + ".json")),
      log_(scratch / ("hapticd_" + mode + ".log")),
      child_({.command = {beside_this_program("hapticd"), scene, "--mode", mode, "--domain",
                          std::to_string(domain), "--json", figures_.string()},
              .output = log_.string()}) {
  for (int i = 0; i < 600 && child_.running() && !ready(); ++i) usleep(100'000);
  if (!ready()) throw std::runtime_error("hapticd did not start: " + text_of(log_));
  stop();
}

SoakDaemon::~SoakDaemon() {
  go_on();
  child_.signal(SIGTERM);
  child_.wait(5);
}

bool SoakDaemon::ready() const { return text_of(log_).find("ready") != std::string::npos; }

nlohmann::json SoakDaemon::summary() {
  std::filesystem::remove(figures_);
  child_.signal(SIGUSR1);
  for (int i = 0; i < 3000; ++i) {
    if (std::filesystem::exists(figures_)) return last_ = nlohmann::json::parse(text_of(figures_));
    if (!child_.running()) break;
    usleep(1000);
  }
  throw std::runtime_error("hapticd gave no figures: " + text_of(log_));
}

}  // namespace hapticd
