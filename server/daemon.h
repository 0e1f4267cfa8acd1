// The daemon as one object: what is made, started and stopped, in which order.
//
//   scene → world → DDS (before any thread goes SCHED_FIFO) → loops
//   start: simulation, then haptic, then diagnostics;   stop: haptic first (the device feels zero),
//   then simulation, then diagnostics (which drains what they left)
//
// Thread safety: one owner thread. Errors: the constructor and start throw std::runtime_error or
// std::invalid_argument; a refused privilege is a Grant, not an error.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "server/device_bridge.h"
#include "server/realtime.h"
#include "server/simulation_loop.h"

namespace hapticd {

struct DaemonOptions {
  std::uint32_t domain = 0;
  std::optional<std::filesystem::path> record;
  std::optional<Security> security;
};

class Daemon {
 public:
  Daemon(const Scene& scene, const DaemonOptions& options);
  ~Daemon();

  // What the operating system granted is complete when start returns.
  void start();
  void stop() noexcept;

  bool failed() const noexcept { return simulation_.failed(); }
  const std::string& failure() const noexcept { return simulation_.failure(); }
  const std::vector<Grant>& grants() const noexcept { return grants_; }
  // Figures of the run so far; keys as tools/demo's summary uses them.
  nlohmann::json summary() const;

 private:
  const Scene& scene_;
  std::unique_ptr<World> world_;
  std::vector<Grant> grants_;
  CpuLatency latency_;
  int realtime_core_;
  std::optional<ScopedCore> on_realtime_core_;  // while DDS makes its threads, which inherit it
  Domain domain_;
  Participant participant_;
  DdsDevicePort port_;
  Channel<CondensedProblem> problems_;
  Channel<InstrumentInput> instrument_;
  Channel<SceneSnapshot> snapshots_;
  SpscQueue<ForceRecord> history_;
  SimulationLoop simulation_;
  HapticLoop haptic_;
  Diagnostics diagnostics_;
};

}  // namespace hapticd
