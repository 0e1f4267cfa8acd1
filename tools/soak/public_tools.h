// The public tools that a soak compares itself with: cyclictest (rt-tests) and ddsperf (cyclonedds-tools).
//
// cyclictest runs one thread at 1 kHz with the haptic loop's policy, priority and core, memory locked. It
// leaves out the wake-ups that a late one hides; the haptic loop counts them. So that the ratio compares like
// with like, `with_hidden_wakeups` gives its figures the loop's accounting: a wake-up late by L ≥ T stands
// for those late by L − T, L − 2T, … as well. ddsperf answers pings of a device state's size at 1 kHz: pong
// with the loop's priority and core, ping with the client's, both with the DDS profile that the daemon uses.
// It prints half the round trip, and percentiles each second; here they are doubled, and a run's percentile
// is the mean of its seconds'. Units: µs. Errors: std::runtime_error when a tool gives nothing that can be
// read.
#pragma once

#include <string>

#include "tools/soak/tally.h"

namespace hapticd {

struct PingFigures {
  std::uint64_t count = 0;
  double p50_sum = 0, p99_sum = 0, max = 0;  // sums weighted by count

  void add(double p50, double p99, double largest, std::uint64_t n);
  void merge(const PingFigures& other);
  double p50() const { return count ? p50_sum / static_cast<double>(count) : 0; }
  double p99() const { return count ? p99_sum / static_cast<double>(count) : 0; }
};

Tally read_cyclictest(const std::string& output);
Tally with_hidden_wakeups(const Tally& late_us, double period_us = 1000);
PingFigures read_ddsperf(const std::string& output);

// Blocking; `scratch` is a directory for their outputs.
Tally run_cyclictest(double seconds, int core, int priority, const std::string& scratch);
PingFigures run_ddsperf(double seconds, int pong_core, int ping_core, int domain, const std::string& scratch);

}  // namespace hapticd
