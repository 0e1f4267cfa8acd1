#include "tools/stability/bench/largest_stiffness.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace hapticd {
namespace {

// A press meets ticks and quanta by chance: what is sound is sound wherever it starts, of so many places that
// no quantum or tick divides evenly. Every fourth finds the limit, all of them confirm it: by four
// alone a wall passed that breaks from twelve of sixteen.
constexpr int few = 4;
constexpr double between_starts = 3.1e-6;       // [m]
constexpr double between_zeros = 0.6180339887;  // of a quantum: any so many starts are spread over it

// Up by √2 until `breaks`, then by halves until what is sound and what breaks are a factor apart.
template <class Breaks>
double last_sound(const Breaks& breaks, double from, double to, double factor) {
  double sound = 0, broken = from;
  while (broken <= to && !breaks(broken)) {
    sound = broken;
    broken *= std::numbers::sqrt2;
  }
  while (sound > 0 && broken > sound * factor) {
    const double middle = std::sqrt(sound * broken);
    (breaks(middle) ? broken : sound) = middle;
  }
  return sound;
}

}  // namespace

ClosedLoopSettings begun_at(const ClosedLoopSettings& s, const Starts& starts, int k) {
  ClosedLoopSettings there = s;
  there.press.start -= k * between_starts * s.press.direction;
  if (starts.moves_encoder) there.encoder_zero = std::fmod(k * between_zeros, 1.0) * s.hand.quantum;
  return there;
}

Largest largest_sound(const std::function<ClosedLoopResult(double, const ClosedLoopSettings&)>& run,
                      const ClosedLoopSettings& s, double from, double to, double factor,
                      const std::function<double(double, const ClosedLoopResult&)>& displayed,
                      const Starts& starts) {
  const auto any = [&](double value, const auto& unsound, int every) {
    for (int k = 0; k < starts.count; k += every) {
      if (unsound(run(value, begun_at(s, starts, k)))) return true;
    }
    return false;
  };
  const auto limit = [&](const auto& unsound, double least) {
    double value = last_sound([&](double v) { return any(v, unsound, std::max(1, starts.count / few)); },
                              least, to, factor);
    while (value >= least && any(value, unsound, 1)) value /= factor;
    return value >= least ? value : 0;
  };
  const auto swinging = [&](const ClosedLoopResult& r) { return swings(r, s.hand); };
  const auto active = [&](const ClosedLoopResult& r) { return swings(r, s.hand) || makes_energy(r); };
  const auto shown = [&](double value) { return value > 0 ? displayed(value, run(value, s)) : 0; };
  const double passive = limit(active, from);
  // What makes no energy does not swing.
  const double steady = std::max(limit(swinging, std::max(from, passive)), passive);
  return {shown(steady), shown(passive)};
}

}  // namespace hapticd
