// What the commands that act as a device have in common: their options, their run and their report.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "server/record/trajectory_reader.h"
#include "tools/cli/report.h"
#include "tools/client/client.h"
#include "tools/client/monitor.h"

namespace hapticd {

struct SessionOptions {
  ClientSettings client;
  std::string secure;  // folder of keys; empty: none
  std::string role = "device";
  std::string json;       // empty: none
  std::string forces;     // CSV; empty: none
  std::string snapshots;  // directory; empty: none
  bool force = false;     // write over files
  double min_answered = 0.9;
};

void add_session_options(CLI::App& command, SessionOptions& options);
void add_units_option(CLI::App& command, LengthUnit& units, const std::string& text);

// Reads the keys, if any, and makes the directories of the files that will be written. input: the motion's
// file. Throws InputError for an output that would write over another file (server/files/output_file.h).
void prepare(SessionOptions& options, const std::string& input);

// Everything on DDS that a run needs, made before any thread goes SCHED_FIFO.
struct Session {
  Domain domain;
  Participant participant;
  Monitor monitor;
  DeviceClient client;

  Session(const SessionOptions& options, std::int64_t slots);
};

// Runs the source to its end with progress on a terminal, then waits for the last states of the scene.
void run(Session& session, SlotSource& source, const std::string& what);

// The figures of the run.
void report(const Session& session, const SessionOptions& options, nlohmann::ordered_json& json,
            Table& table);

// forces.csv (force_row.h); `removed` is by the newest status.
std::string forces_csv(const Session& session);

// Writes the JSON and the other outputs asked for, prints the table, and returns the exit code: 0 if the run
// is complete, answered as it should be and by one daemon, else 1 with the reason on stderr.
int finish(const Session& session, const SessionOptions& options, const nlohmann::ordered_json& json,
           const Table& table);

}  // namespace hapticd
