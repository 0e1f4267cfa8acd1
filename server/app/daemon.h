// The daemon as one object: what is made, started and stopped, in which order.
//
//   scene → DDS (before any thread goes SCHED_FIFO) → a session per world (world_session.h): devices, loops
//   start: simulations and haptic loops, then diagnostics;   stop: haptic loop first (the device feels zero),
//   then simulation, then diagnostics (which drains what they left)
//
// Thread safety: one owner thread, but for metrics. Errors: the constructor and start throw
// std::runtime_error or std::invalid_argument; a refused privilege is a Grant, not an error.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "haptic/clock.h"
#include "server/app/world_session.h"
#include "server/dds/command.h"
#include "server/observe/metrics.h"
#include "server/os/core_isolation.h"

namespace hapticd {

struct DaemonOptions {
  std::uint32_t domain = 0;
  LoopMode mode = LoopMode::tick;
  std::optional<std::filesystem::path> record;  // of the scene's instruments (world_session.h)
  std::optional<std::filesystem::path>
      capture;                      // a directory for contact problems (haptic/contact_capture.h)
  std::uint64_t capture_every = 0;  // solves; 0: only those that end at a cap
  std::optional<Security> security;
  std::optional<std::filesystem::path> schedule = {};  // of the scene's first device (schedule_file.h)
  std::vector<std::uint32_t> edge_devices = {};        // by id, answered at an edge (server/edge), not here
  bool tank = true;                                    // beside an edge (world_session.h)
  // Where the edge is, in the process's network; devices are then on this machine alone. None: in `domain`.
  std::optional<std::uint32_t> edge_domain = {};
};

class Daemon {
 public:
  Daemon(const Scene& scene, const DaemonOptions& options);
  ~Daemon();

  // What the operating system granted is complete when start returns.
  void start();
  void stop() noexcept;

  // The simulation from its start, of this scene or another one: devices are at zero meanwhile, and their
  // forces rise in 100 ms with its first problem. Throws what making a world does, and std::runtime_error
  // while a schedule or captures are written; the old world then goes on. make: called while the devices are
  // at zero; a scene with the same device ids in the same order.
  void reset();
  void restart(const std::function<Scene()>& make);

  // What is asked over DDS; null: the keys do not allow it.
  CommandPort* commands() noexcept { return commands_ ? &*commands_ : nullptr; }

  bool failed() const noexcept;
  std::string failure() const;
  const std::vector<Grant>& grants() const noexcept { return grants_; }
  // Figures of the run so far; keys as tools/demo's summary uses them. The first device's at the top level,
  // the others' under more_devices, whichever world they are in.
  nlohmann::json summary() const;
  // The same counters for a monitoring system; any thread, after start.
  std::string metrics() const;
  const std::vector<std::unique_ptr<WorldSession>>& sessions() const noexcept { return sessions_; }

 private:
  void simulate(const std::function<const Scene&()>& scene);

  const Scene* scene_;
  std::unique_ptr<const Scene> own_, former_;  // of restarts; the former for who still shows it
  mutable std::mutex exchange_;                // of a world, while figures are read
  const std::int64_t made_ns_ = monotonic_ns();
  std::vector<Grant> grants_;
  CpuLatency latency_;
  // The last and the first of those that the process may use.
  int realtime_core_, simulation_core_;
  CoreIsolation core_isolation_;
  std::optional<ScopedCore> on_realtime_core_;  // while DDS makes its threads, which inherit it
  Domain domain_;
  Participant participant_;
  std::optional<Domain> edge_domain_;
  std::optional<Participant> edge_participant_;
  std::optional<CommandPort> commands_;
  std::vector<std::unique_ptr<WorldSession>> sessions_;
};

}  // namespace hapticd
