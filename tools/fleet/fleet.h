// What the stations on a network do, from what they say: a plain value, told every message with its origin
// and time.
//
//   a station    a DDS partition; its programs (a daemon, or an edge and a simulation) are participants
//   a device     of one program: two programs that answer for one device are two entries, and a fault
//   lost         a program is silent for `silence_ns`; ended: it has said good-bye
//
// A station's state is the worst of its devices'. Faults that come and go are kept with their times, the
// newest `most_lines` of a station. Stations that ended are forgotten after a minute, lost ones are kept
// until their place is needed: whoever makes up names gets `most_stations` of them, with `most_devices` each.
// Units: ns (CLOCK_MONOTONIC of this machine), else as in idl/scene.idl. Thread safety: one thread. Errors:
// none.
#pragma once

#include <dds/dds.h>

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "idl/scene.h"  // generated from idl/scene.idl

namespace hapticd {

inline constexpr std::int64_t silence_ns = 700'000'000;  // seven statuses
inline constexpr std::int64_t ended_for_ns = 60'000'000'000;
inline constexpr std::size_t most_lines = 20, trace_bins = 100;  // of 100 ms
inline constexpr std::size_t most_stations = 256, most_devices = 16;

using ProgramKey = std::array<std::uint8_t, 16>;  // of a participant

// Whose message it is.
struct Origin {
  std::string station, host;
  ProgramKey program{};
};

enum class StationState { idle, in_use, fault, lost, ended };
const char* word(StationState state);

struct StationFault {
  std::string what, detail;
  bool severe = false;
};

struct FaultLine {
  std::string what;
  std::int64_t from_ns = 0, until_ns = 0;  // until 0: still
};

// The largest force of each 100 ms, the newest ten seconds; a gap is NaN.
class ForceTrace {
 public:
  // As ServerHealth has it: `blocks` so far, `count` of them here, 4 numbers each.
  void take(std::uint64_t blocks, const float* force, std::size_t count);
  std::vector<float> newest() const;  // oldest first
  float last_second() const;          // the largest; 0: none

 private:
  std::uint64_t blocks_ = 0;
  std::array<float, trace_bins> bin_{};
};

struct FleetDevice {
  std::uint32_t id = 0;
  std::string host, scene, refused, device, compliance;
  std::uint32_t status = 1;
  double haptic_hz = 0, sim_hz = 0, step_ms = 0;
  std::uint32_t removed = 0, aspirated = 0, rejected = 0, conflicts = 0;
  std::uint64_t deadline_misses = 0;
  std::int64_t heard_ns = 0;
  std::uint64_t step = 0, step_mark = 0;  // newest; up to two seconds ago: sim_hz is of what lies between
  std::int64_t step_mark_ns = 0;
  bool sim_rate_known = false;
  bool ended = false, lost = false;
  // Of ServerHealth; health_ns 0: none yet.
  std::int64_t health_ns = 0;
  double period_ms = 0, max_force = 0, wake_p999_us = 0;
  bool degraded = false;
  ForceTrace trace;
  std::vector<std::uint32_t> wake, wake_base;  // counts: newest, and of five to ten seconds ago
  std::vector<std::uint32_t> wake_next;
  std::int64_t wake_ns = 0;

  bool live() const noexcept { return !ended && !lost; }
  bool armed() const noexcept { return live() && (status & 1) == 0; }
};

struct FleetOperation {
  std::string scene;
  double gone_most = 0;            // of a body, a share of its volume
  nlohmann::ordered_json figures;  // operation_json.h
};

struct Station {
  std::string name;
  StationState state = StationState::idle;
  std::map<std::pair<std::uint32_t, ProgramKey>, FleetDevice> devices;
  std::map<std::uint32_t, FleetOperation> operations;  // by the device id of the world's first instrument
  std::vector<StationFault> faults;
  std::deque<FaultLine> lines;
  std::int64_t first_ns = 0, heard_ns = 0;
  bool looked_at = false;
};

class Fleet {
 public:
  void hear(const Origin& of, const hapticd_msg_ServerStatus& m, std::int64_t now_ns);
  void hear(const Origin& of, const hapticd_msg_ServerHealth& m, std::int64_t now_ns);
  void hear(const Origin& of, const hapticd_msg_SceneOperation& m, std::int64_t now_ns);
  void leave(const ProgramKey& program);
  // After what was heard: silence, states, faults. Returns the stations that are new or whose state or faults
  // changed.
  std::vector<std::string> look(std::int64_t now_ns);

  const std::map<std::string, Station>& stations() const noexcept { return stations_; }
  // Messages of stations and devices beyond those.
  std::uint64_t left_out() const noexcept { return left_out_; }

 private:
  Station* station(const std::string& name,
                   std::int64_t now_ns);  // null: there are `most_stations` live ones
  bool has_place();

  std::map<std::string, Station> stations_;
  std::uint64_t left_out_ = 0;
};

}  // namespace hapticd
