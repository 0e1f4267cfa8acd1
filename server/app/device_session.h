// One device's place in the daemon: its port, its watchdogs and limits, its haptic thread, and its own
// tissue.
//
// DeviceSessions share the process, the DDS participant and the scene's description, and nothing else: no
// channel, no queue and no lock of ours is common to two of them, so that what one client does is not felt at
// another. Each has its own world, stepped by its own simulation thread: several people at the same scene,
// each with a copy of it. (Two instruments in one tissue is what the simulated world cannot do yet.) Thread
// safety: one owner thread. Errors: the constructor and start throw std::runtime_error or
// std::invalid_argument.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "server/app/simulation_loop.h"
#include "server/dds/device_bridge.h"
#include "server/observe/metrics.h"
#include "server/os/realtime.h"
#include "server/schedule/schedule_recorder.h"

namespace hapticd {

struct DeviceSessionOptions {
  LoopMode mode = LoopMode::tick;
  int realtime_core = 0;    // of the haptic thread
  int simulation_core = 0;  // where it is another
  bool shows_scene = true;  // publishes geometry and updates: the first station does
  std::optional<std::filesystem::path> record;
  std::optional<std::filesystem::path> capture;   // a directory for contact problems
  std::uint64_t capture_every = 0;                // solves; 0: only those that end at a cap
  std::optional<std::filesystem::path> schedule;  // a file for the run's schedule (schedule_file.h)
};

class DeviceSession {
 public:
  // Everything referred to must outlive the station.
  DeviceSession(const Scene& scene, const DeviceSettings& device, const Participant& participant,
                const DeviceSessionOptions& options);
  ~DeviceSession();

  // The simulation, then the haptic thread; returns what the latter was granted.
  std::vector<Grant> start_loops();
  // grants: of the whole daemon, for the status topic.
  void start_diagnostics(const std::vector<Grant>& grants);
  // The haptic loop first: the device feels zero.
  void stop() noexcept;

  bool failed() const noexcept { return simulation_.failed(); }
  const std::string& failure() const noexcept { return simulation_.failure(); }
  // New limits and scales for the haptic thread, which goes over to them within a second. One thread alone.
  void retune(const DeviceTuning& tuning) noexcept;

  std::uint32_t device_id() const noexcept { return device_.id; }
  DeviceTuning started_with() const noexcept { return tuning_of(device_); }
  const LoopStatistics& haptic_statistics() const noexcept { return haptic_.statistics(); }
  const SimulationStatistics& simulation_statistics() const noexcept { return simulation_.statistics(); }
  std::uint64_t recording_dropped() const noexcept { return history_.dropped(); }
  MetricsSource metrics() const;
  SimulationLoop& simulation() noexcept { return simulation_; }  // for its test hooks
  nlohmann::json summary() const;

 private:
  const DeviceSettings device_;
  const DeviceSessionOptions options_;
  PartTimes times_{monotonic_ns};  // of the simulation's step
  std::unique_ptr<World> world_;
  DdsDevicePort port_;
  Channel<CondensedProblem> problems_;
  Channel<InstrumentInput> instrument_;
  Channel<SceneSnapshot> snapshots_;
  Channel<ContactCapture> captures_;
  Channel<DeviceTuning> tunings_;
  SpscQueue<ForceRecord> history_;
  std::optional<ScheduleRecorder> schedule_;
  SimulationLoop simulation_;
  HapticLoop haptic_;
  Diagnostics diagnostics_;
};

}  // namespace hapticd
