// haptic soak: the daemon under a client for a long time, measured against public tools in the same minutes.
//
// With `hands` 2 each daemon has a client on each of two devices of one world, and every device has a report
// and bounds of its own. One daemon per mode, of which only one is awake at a time. The run is cycles of some
// 12 s, each with six slices: a client on the daemon in mode `tick`; cyclictest; a client on the daemon in
// mode `event`; `tick` and cyclictest once more; ddsperf. While a tool has its slice both daemons are stopped
// (SIGSTOP), so that neither is measured through the other; the load goes on throughout. The client's motion
// is the scene's trajectory, forth and back, without pedals: the tissue of the last minute is the tissue of
// the first. What the stops do to the daemons' histograms falls between two slices (soak_slice.h). Verdict:
// soak_verdict.h, soak_drift.h.
// `--attach` has no daemon of its own: figures are those that the answers carry, and the daemon is not
// stopped.
#pragma once

#include <string>

#include "tools/client/client.h"

namespace hapticd {

struct SoakOptions {
  double duration = 60;        // [s], arming not counted
  bool until_decided = false;  // goes on, ten times as long at most
  double load = 0;             // [%] of each core
  int hands = 1;               // devices of one world
  std::string json, out, scene, mode = "both";
  bool force = false;
  bool attach = false;
  ClientSettings client;
};

// Returns the exit code.
int soak(SoakOptions options);

}  // namespace hapticd
