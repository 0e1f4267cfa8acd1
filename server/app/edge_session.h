// The haptic half of a daemon as one object, beside its devices: what is made, started and stopped, in which
// order.
//
//   scene → DDS of the devices, DDS of the simulation → a port per device, the haptic loop, the link
//   start: link, haptic loop, diagnostics;   stop: haptic loop first (the devices feel zero), diagnostics,
//   link
//
// The same ports, loop, watchdogs, limits and solve as in a daemon (world_session.h); problems come from the
// link (server/edge/edge_end.h) instead of a simulation thread, and so do hands whose devices are answered
// beside the simulation (remote_hand.h). A second simulation for the same world is a rival, as a second
// daemon is. Devices are in a DDS domain of this machine alone, which may be the simulation's where that is
// on it too. Thread safety: one owner thread. Errors: the constructor and start throw std::runtime_error.
#pragma once

#include <deque>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "server/app/world_session.h"
#include "server/edge/edge_end.h"
#include "server/edge/remote_hand.h"
#include "server/os/core_isolation.h"

namespace hapticd {

struct EdgeOptions {
  std::uint32_t domain = 0;  // of the devices
  std::uint32_t simulation_domain =
      0;  // the same: on this machine; another: in the process's network (network.h)
  LoopMode mode = LoopMode::tick;
  std::optional<std::filesystem::path> record;  // of the first device; others': recordings_of
  std::optional<Security> security;             // of both domains
  bool tank = true;  // the rendering gives back no more than was put in (haptic/passivity.h)
  double late = 0;   // problems are felt until they are so old; 0: as in a daemon [s]
  std::vector<std::uint32_t> devices = {};  // ids of those that are answered here; empty: all
};

class EdgeSession {
 public:
  // The scene must outlive the object.
  EdgeSession(const Scene& scene, const EdgeOptions& options);
  ~EdgeSession();

  void start();
  void stop() noexcept;

  const std::vector<Grant>& grants() const noexcept { return grants_; }
  const LoopStatistics& statistics(int device) const noexcept { return haptic_->statistics(device); }
  const EdgeEnd& link() const noexcept { return *link_; }
  // The loop's figures (diagnostics.h) of the first device, of others under more_devices, and the link's
  // under "edge".
  nlohmann::json summary() const;

 private:
  // A daemon's port that knows of a second simulation.
  class Port final : public DevicePort {
   public:
    Port(const Participant& participant, std::uint32_t device, bool events, int core, Port* leader,
         const EdgeEnd& link)
        : port_(participant, device, events, core, leader ? &leader->port_ : nullptr), link_(link) {}
    bool take(std::int64_t now_ns, DeviceSample& sample) noexcept override {
      rival_ = link_.rival(now_ns);
      return port_.take(now_ns, sample);
    }
    std::int64_t await(std::int64_t until_ns,
                       const EachInstrument<std::int64_t>& earliest_ns) noexcept override {
      return port_.await(until_ns, earliest_ns);
    }
    Presence presence() const noexcept override {
      Presence seen = port_.presence();
      seen.rival = seen.rival || rival_;
      return seen;
    }
    void write(const ForceSample& force) noexcept override { port_.write(force); }
    std::uint64_t foreign_forces() const noexcept { return port_.foreign_forces(); }

   private:
    DdsDevicePort port_;
    const EdgeEnd& link_;
    bool rival_ = false;
  };

  struct Device {
    // hands: none: answered here
    Device(const DeviceSettings& of, const Participant& participant, const EdgeOptions& options, int core,
           Port* leader, const EdgeEnd& link, RemoteHands* hands, int index);
    const DeviceSettings settings;
    std::optional<Port> here;          // either …
    std::optional<RemotePort> remote;  // … or
    DevicePort& port() noexcept {
      if (here) return *here;
      return *remote;
    }
    Channel<SceneSnapshot> snapshots;
    SpscQueue<ForceRecord> history;
    std::optional<Diagnostics> diagnostics;
  };

  const Participant& simulation_side() const noexcept {
    return far_participant_ ? *far_participant_ : participant_;
  }

  std::vector<Grant> grants_;
  CpuLatency latency_;
  int realtime_core_;
  CoreIsolation core_isolation_;
  std::optional<ScopedCore> on_realtime_core_;  // while DDS makes the threads of the devices' domain
  Domain domain_;
  Participant participant_;
  std::optional<Domain> far_domain_;
  std::optional<Participant> far_participant_;
  const std::vector<Instrument> instruments_;
  const EachInstrument<bool> at_simulation_;
  Channel<InstrumentInputs> inputs_, others_;
  RemoteHands hands_{others_};
  Channel<CondensedProblem> problems_;
  std::optional<EdgeEnd> link_;
  std::deque<Device> devices_;
  std::optional<HapticLoop> haptic_;
};

}  // namespace hapticd
