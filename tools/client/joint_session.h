// Several devices of one process at one daemon, each with its own client, on one time axis (common_start.h).
//
//   which devices   those named by --device-id, else those of the instruments given, else those of the
//                   daemon's instruments in their order
//   files           FORCES.csv of the first, FORCES.NAME.csv of the others (server/files/output_file.h); NAME
//                   is the instrument's, or the id where ids were named
//   figures         `devices`, one after another, each as of a run alone (session.h), and start_skew_us: how
//                   far apart the slots 0 of two devices were
//
// A device whose motion ends first is let go of then. Thread safety: one thread; each client has threads of
// its own. Errors: as Session's; the first device that fails ends the others.
#pragma once

#include <deque>
#include <functional>

#include "tools/record/instrument_list.h"
#include "tools/client/session.h"

namespace hapticd {

class JointSession {
 public:
  // instruments: of the scene; none: the daemon is asked. Throws UsageError where there are fewer than `count`.
  JointSession(const SessionOptions& options, std::size_t count, std::vector<HeardInstrument> instruments);

  std::size_t count() const noexcept { return devices_.size(); }
  const HeardInstrument& device(std::size_t i) const noexcept { return devices_[i]; }

  // Refuses files of forces that are not to be written over; inputs: what the run reads.
  void check_outputs(const std::vector<std::string>& inputs) const;
  // Plays sources[i] for slots[i] as device i, to the end.
  void run(const std::vector<SlotSource*>& sources, const std::vector<std::int64_t>& slots,
           const std::string& what);
  // Adds the figures, writes what was asked for, prints, and returns the exit code. each: what is to be said of
  // a device besides.
  int finish(nlohmann::ordered_json& json, Table& table,
             const std::function<void(std::size_t, nlohmann::ordered_json&, Table&)>& each);

 private:
  struct Device {
    Monitor monitor;
    DeviceClient client;

    Device(const Participant& participant, const ClientSettings& settings, std::int64_t slots)
        : monitor(participant, settings.device_id), client(participant, settings, slots) {}
  };

  std::vector<std::string> names() const;
  void play(std::size_t i, SlotSource& source, const std::function<void(std::int64_t)>& poll);
  void leave() noexcept;

  const SessionOptions options_;
  Domain domain_;
  Participant participant_;
  std::vector<HeardInstrument> devices_;
  CommonStart start_;
  std::deque<Device> played_;
  std::optional<WatchedMachine> machine_;  // after `run`, where it was asked for
};

}  // namespace hapticd
