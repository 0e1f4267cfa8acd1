// One world in the daemon: its tissue, its simulation thread, its haptic thread, and the devices of its
// instruments.
//
// A world has one device an instrument; its haptic thread solves one contact problem for all of them. Each
// device has its own port, watchdog, limits, statistics, recording and diagnostics. Sessions share the
// process, the DDS participant and the scene's description, and nothing else: no channel, no queue and no
// lock of ours is common to two of them. A device that an edge answers is in the problem as the edge tells of
// it (remote_hand.h); nothing is written to it here. A scene's `more_devices` have a world each: several
// people at the same scene, each with a copy of its tissue. Thread safety: one owner thread. Errors: the
// constructor and start throw std::runtime_error or std::invalid_argument.
#pragma once

#include <deque>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "haptic/clock.h"
#include "server/app/simulation_loop.h"
#include "server/dds/device_bridge.h"
#include "server/edge/remote_hand.h"
#include "server/edge/simulation_end.h"
#include "server/observe/metrics.h"
#include "server/os/realtime.h"
#include "server/schedule/schedule_recorder.h"

namespace hapticd {

struct WorldSessionOptions {
  LoopMode mode = LoopMode::tick;
  int realtime_core = 0;                          // of the haptic thread
  int simulation_core = 0;                        // where it is another
  int world = 0;                                  // the first one publishes the scene's geometry and updates
  std::optional<std::filesystem::path> record;    // of the first device; others': recordings_of
  std::optional<std::filesystem::path> capture;   // a directory for contact problems
  std::uint64_t capture_every = 0;                // solves; 0: only those that end at a cap
  std::optional<std::filesystem::path> schedule;  // a file for the run's schedule (schedule_file.h)
  // Of devices that another process answers (server/edge). All of the world's: there is no haptic loop here.
  std::vector<std::uint32_t> edge_devices = {};
  bool tank = true;  // beside an edge, the rendering gives back no more than was put in (haptic/passivity.h)
};

inline constexpr std::size_t history_ticks = 8192;  // 8 s of ticks may wait for a slow disk

// Starts the loop on this core at its priority; returns what it was granted.
std::vector<Grant> start_haptic_thread(HapticLoop& loop, int core);

// One an instrument of the scene (server/files/output_file.h).
std::vector<std::filesystem::path> recordings_of(const std::filesystem::path& file, const Scene& scene);

class WorldSession {
 public:
  // devices: one an instrument of the scene, in their order. to_edge: where the edge is, if there is one.
  // Everything referred to must outlive the session.
  WorldSession(const Scene& scene, const std::vector<DeviceSettings>& devices, const Participant& participant,
               const Participant& to_edge, const WorldSessionOptions& options);
  ~WorldSession();

  // The simulation, then the haptic thread; returns what the latter was granted.
  std::vector<Grant> start_loops();
  // grants: of the whole daemon, for the status topic.
  void start_diagnostics(const std::vector<Grant>& grants);
  // The haptic loop first: the devices feel zero.
  void stop() noexcept;

  bool failed() const noexcept { return now_->loop->failed(); }
  const std::string& failure() const noexcept { return now_->loop->failure(); }
  // Another world in place of this one, in four parts, by one thread alone. `rest` lets the devices' forces
  // go to zero and ends the simulation; `prepare` makes the new world, and may throw; then either `commit`
  // lets it go on, or `abandon` the old one. Clients, arming, limits, recordings and the haptic thread stay;
  // forces rise in 100 ms with the first problem. Pre: no schedule and no capture is written; as many devices
  // with the same ids.
  void rest() noexcept;
  void prepare(const Scene& scene, const std::vector<DeviceSettings>& devices);
  void commit() noexcept;
  void abandon() noexcept;
  bool may_restart() const noexcept { return !options_.schedule && !options_.capture; }

  // New limits and scales of a device for the haptic thread, which goes over to them within a second. One
  // thread alone.
  void retune(int device, const DeviceTuning& tuning) noexcept;

  int devices() const noexcept { return static_cast<int>(devices_.size()); }
  std::uint32_t device_id(int i) const noexcept { return device(i).settings.id; }
  const LoopStatistics& haptic_statistics(int i) const noexcept { return haptic_->statistics(i); }
  const SimulationStatistics& simulation_statistics() const noexcept { return now_->loop->statistics(); }
  std::uint64_t recording_dropped(int i) const noexcept { return device(i).history.dropped(); }
  MetricsSource metrics(int device) const;
  SimulationLoop& simulation() noexcept { return *now_->loop; }  // for its test hooks
  // How often the thread has turned that must: the haptic loop's, or the link's to an edge.
  std::uint64_t haptic_turns() const noexcept;
  // A device's figures, and those of the world.
  nlohmann::json summary(int device) const;

 private:
  struct Device {
    // hands: none: answered here
    Device(const DeviceSettings& of, const std::string& name, const Participant& participant,
           const WorldSessionOptions& options, DdsDevicePort* leader, RemoteHands* hands, int index);

    const DeviceSettings settings;
    const std::string instrument;      // its name
    std::optional<DdsDevicePort> dds;  // either …
    std::optional<RemotePort> remote;  // … or
    Channel<SceneSnapshot> snapshots;
    Channel<DeviceTuning> tunings;
    SpscQueue<ForceRecord> history;
    std::optional<Diagnostics> diagnostics;

    DdsDevicePort* leader() noexcept { return dds ? &*dds : nullptr; }
    DevicePort& port() noexcept {
      if (dds) return *dds;
      return *remote;
    }
    std::uint64_t foreign_forces() const noexcept { return dds ? dds->foreign_forces() : 0; }
  };

  // What goes when another world comes.
  struct Simulated {
    Simulated(const Scene& scene, PartTimes& times, const Simulated* before);
    const Scene* scene;
    std::unique_ptr<World> world;
    int regions;  // that were condensed before the clock starts
    Channel<CondensedProblem> problems;
    std::optional<SimulationLoop> loop;
  };

  std::unique_ptr<Simulated> simulated(const Scene& scene);
  HapticOptions loop_options(const Scene& scene) const;
  std::vector<DeviceSettings> as_answered(std::vector<DeviceSettings> devices) const;
  bool has_edge() const noexcept { return devices_here_ < devices(); }
  Grant start_simulation();

  const Device& device(int i) const noexcept { return devices_[static_cast<std::size_t>(i)]; }
  std::vector<LoopDevice> loop_devices();
  std::vector<Channel<SceneSnapshot>*> snapshots();

  const WorldSessionOptions options_;
  PartTimes times_{monotonic_ns};  // of the simulation's step
  // Who is answered here; the others by the edge.
  const EachInstrument<bool> here_;
  const int devices_here_;
  Channel<InstrumentInputs> instruments_, told_, own_;  // told_, own_: by the edge, to it
  RemoteHands hands_{told_};
  std::deque<Device> devices_;
  Channel<CondensedProblem> copies_;
  std::optional<SimulationEnd> edge_;
  Channel<ContactCapture> captures_;
  std::optional<ScheduleRecorder> schedule_;
  std::unique_ptr<Simulated> now_, next_;
  std::unique_ptr<HapticTick> next_tick_;
  std::optional<HapticLoop> haptic_;
};

}  // namespace hapticd
