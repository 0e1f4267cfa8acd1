// Steps that take a random time, as on a machine that has more to do.
//
//   published   8 ms · exp(σ n) after a step's begin, n normal;   its pose a third of that after it
//
// Of σ = 1 one in six takes more than a period of 20 ms. Deterministic by its seed. Units: ns.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

#include "server/schedule/virtual_daemon.h"

namespace hapticd {

class LateSteps {
 public:
  LateSteps(double spread, std::uint64_t seed) : spread_(spread), random_(seed) {}

  // Before each action of `daemon`: a step that begins is given its time, all else is as usual.
  void before(StepAction action, const VirtualTiming& usual, VirtualDaemon& daemon) {
    if (action != StepAction::begin) return;
    const std::int64_t takes = std::llround(median_ns * std::exp(spread_ * normal_(random_)));
    VirtualTiming timing = usual;
    timing.publish = takes;
    timing.late = std::max<std::int64_t>(0, takes - daemon.schedule().period_ns());
    timing.latch = takes / 3;
    daemon.set_timing(timing);
  }

 private:
  static constexpr double median_ns = 8e6;

  double spread_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

}  // namespace hapticd
