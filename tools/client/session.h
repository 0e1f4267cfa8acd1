// What the commands that act as a device have in common: their options, their run and their report.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "server/record/trajectory_reader.h"
#include "tools/cli/report.h"
#include "tools/client/client.h"
#include "tools/client/monitor.h"
#include "tools/client/stall_watch.h"

namespace CLI {
class App;
}

namespace hapticd {

struct SessionOptions {
  ClientSettings client;
  std::string secure;  // folder of keys; empty: none
  std::string role = "device";
  std::string json;                       // empty: none
  std::string forces;                     // CSV; empty: none
  std::string snapshots;                  // directory; empty: none
  std::vector<double> snapshots_at = {};  // besides the first and the last [s]
  bool force = false;                     // write over files
  double min_answered = 0.9;
  bool watch_machine = false;          // the slots that a stall of the machine strikes are judged apart
  std::vector<std::uint32_t> devices;  // as named by --device-id; none: not named
};

void add_session_options(CLI::App& command, SessionOptions& options);
void add_units_option(CLI::App& command, LengthUnit& units, const std::string& text);

// Reads the keys, if any, and makes the directories of the files that will be written. inputs: the motions'
// files. Throws InputError for an output that would write over another file (server/files/output_file.h), and
// UsageError where more devices are named than there are motions, or one twice.
void prepare(SessionOptions& options, const std::vector<std::string>& inputs);
// What a file of forces has to satisfy; inputs: what the run reads.
void require_forces(const SessionOptions& options, const std::string& file,
                    const std::vector<std::string>& inputs);

// Everything on DDS that a run needs, made before any thread goes SCHED_FIFO.
struct Session {
  Domain domain;
  Participant participant;
  Monitor monitor;
  DeviceClient client;
  std::optional<WatchedMachine> machine;  // after `run`, where it was asked for

  Session(const SessionOptions& options, std::int64_t slots);
};

// A device that has been played.
struct Played {
  const Monitor& monitor;
  const DeviceClient& client;
  const std::optional<WatchedMachine>& machine;

  Played(const Monitor& m, const DeviceClient& c, const std::optional<WatchedMachine>& w)
      : monitor(m), client(c), machine(w) {}
  Played(const Session& s) : Played(s.monitor, s.client, s.machine) {}  // NOLINT: the usual case is one
};

// Runs the source to its end with progress on a terminal, then waits for the last states of the scene.
void run(Session& session, const SessionOptions& options, SlotSource& source, const std::string& what);

// What `play` does, with the machine watched meanwhile where that is asked for.
std::optional<WatchedMachine> while_watching(const SessionOptions& options,
                                             const std::function<void()>& play);

// The figures of the run.
void report(const Played& played, const SessionOptions& options, nlohmann::ordered_json& json, Table& table);

// forces.csv (force_row.h); `removed` is by the newest status.
std::string forces_csv(const Played& played);

// Why the run is no good: it is not complete, not answered as it should be, or by two daemons. Empty: it is
// good.
std::string fault_of(const Played& played, const SessionOptions& options);

// Writes the JSON and the other outputs asked for, prints the table, and returns the exit code: 0 if the run
// is good, else 1 with the reason on stderr.
int finish(const Session& session, const SessionOptions& options, const nlohmann::ordered_json& json,
           const Table& table);

}  // namespace hapticd
