// haptic soak: the daemon under a client for a long time, measured against public tools in the same minutes.
//
// One daemon per mode, of which only one is awake at a time. The run is cycles of some 12 s, each with four
// slices: a client on the daemon in mode `tick`; cyclictest; a client on the daemon in mode `event`; ddsperf.
// While a tool has its slice both daemons are stopped (SIGSTOP), so that neither is measured through the
// other; the load goes on throughout. The client's motion is the scene's trajectory, forth and back, without
// pedals: the tissue of the last minute is the tissue of the first. A slice's daemon figures are the
// difference of two of its summaries (SIGUSR1), one behind the arming, one before letting go: what the stops
// do to the histograms falls in between.
// `--attach` has no daemon of its own: figures are those that the answers carry, and the daemon is not
// stopped.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tools/public_tools.h"
#include "tools/session.h"

namespace hapticd {

struct SoakOptions {
  double duration = 60;  // [s], arming not counted
  double load = 0;       // [%] of each core
  std::string json, out, scene, mode = "both";
  bool attach = false;
  ClientSettings client;
};

// What one daemon gave over some slices.
struct ServerFigures {
  Tally wake_us, solve_us, write_us, interval_us, state_age_us, problem_age_ms, rtt_us, rtt_less_compute_us;
  std::int64_t scheduled = 0, sent = 0, answered = 0;  // the client's slots
  std::int64_t misses = 0, steps = 0;
  double force_peak = 0;
  double seconds = 0;
  void merge(const ServerFigures& other);
};

// Everything of some part of the run.
struct SoakFigures {
  ServerFigures tick, event;
  Tally cyclictest_us;  // with the wake-ups that late ones hid
  PingFigures ddsperf;
  double rss_mb = 0;  // of all daemons, at the end of the part
  void merge(const SoakFigures& other);
};

// A bound and whether it was kept.
struct SoakCheck {
  std::string what;
  double value = 0, limit = 0;
  bool at_most = true;
  bool known = true;
  bool kept() const { return known && (at_most ? value <= limit : value >= limit); }
};

// Of one part against another of the same run: largest ratio of a percentile's median, either way round.
double drift(const std::vector<double>& first, const std::vector<double>& last);

int soak(SoakOptions options);

}  // namespace hapticd
