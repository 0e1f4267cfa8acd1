#include "tools/closed_loop.h"

#include <algorithm>
#include <cmath>

namespace hapticd {

namespace {

constexpr double tick_s = 1e-3;
constexpr double ramped_up = 0.15;  // of arming: status bits before that are arming's own [s]

// Press, hold, deeper, hold, and back.
HandTarget target(const ClosedLoopSettings& s, double t) {
  const double first = s.press.depth / s.press.speed + s.press.hold;
  Press deeper = s.press;
  deeper.start = s.press.start + s.press.depth * s.press.direction;
  deeper.depth = s.deeper;
  HandTarget at = t < first ? target_at(s.press, t) : target_at(deeper, t - first);
  if (s.sway) at.x += s.sway(t);
  return at;
}

struct Plateau {
  double depth = 0, force = 0, swing = 0;
};

// The last half of the hold that ends at `end`.
Plateau plateau(const std::vector<ClosedLoopTick>& ticks, double end, double hold) {
  Plateau p;
  double low = 1e300, high = -1e300;
  int n = 0;
  for (const ClosedLoopTick& tick : ticks) {
    if (tick.t < end - hold / 2 || tick.t >= end) continue;
    low = std::min(low, tick.depth);
    high = std::max(high, tick.depth);
    p.depth += tick.depth;
    p.force += tick.force;
    ++n;
  }
  if (n == 0) return p;
  p.depth /= n;
  p.force /= n;
  p.swing = high - low;
  return p;
}

}  // namespace

ClosedLoopResult run_closed_loop(Renderer& renderer, const ClosedLoopSettings& s) {
  check(s.hand);
  ClosedLoopResult result;
  const double first = s.press.depth / s.press.speed + s.press.hold,
               second = first + s.deeper / s.press.speed + s.press.hold;
  const auto ticks = static_cast<std::int64_t>(std::lround((s.arm + second) / tick_s));
  HandState hand;
  hand.x = s.press.start;
  ForceDelay delay(s.hand.delay);
  double energy = 0, dissipated = 0;
  Vec3 before = Vec3::Zero();
  for (std::int64_t i = 0; i < ticks; ++i) {
    const double t = tick_s * static_cast<double>(i) - s.arm;
    const std::int64_t ns = 1'000'000 * i;
    DeviceSample sample;
    sample.sequence = static_cast<std::uint64_t>(i) + 1;
    sample.pose = {quantised(hand.x, s.hand.quantum), s.orientation};
    sample.enable = true;
    const ForceSample answer = renderer.tick(!s.arrives || s.arrives(i) ? &sample : nullptr);
    if (!answer.force.allFinite() || !hand.x.allFinite()) {
      result.finite = false;
      return result;
    }
    delay.push(ns, answer.force);
    const Vec3 travelled = hand.x - s.press.start;
    result.ticks.push_back(
        {t, travelled.dot(s.press.direction), -answer.force.dot(s.press.direction), answer.status});
    if (t > ramped_up - s.arm) {
      result.status |= answer.status;
      result.force_max = std::max(result.force_max, answer.force.norm());
      result.force_step_max = std::max(result.force_step_max, (answer.force - before).norm());
    }
    before = answer.force;
    const double h = tick_s / s.substeps;
    for (int k = 0; k < s.substeps; ++k) {
      const double part = static_cast<double>(k) / s.substeps;
      const Vec3 force = saturated(delay.at(ns + static_cast<std::int64_t>(1e6 * part)), s.hand.saturation);
      const Vec3 x = hand.x;
      hand = advanced(s.hand, hand, target(s, std::max(0.0, t + tick_s * part)), force, h);
      energy -= force.dot(hand.x - x);
      dissipated += h * s.hand.device_damping * hand.v.squaredNorm();
      result.energy_min = std::min(result.energy_min, energy);
      result.surplus_min = std::min(result.surplus_min, energy + dissipated);
    }
  }
  const Plateau one = plateau(result.ticks, first, s.press.hold),
                two = plateau(result.ticks, second, s.press.hold);
  result.swing = std::max(one.swing, two.swing);
  result.force = two.force;
  if (two.depth > one.depth) result.stiffness = (two.force - one.force) / (two.depth - one.depth);
  return result;
}

}  // namespace hapticd
