#include "tools/stability/bench/closed_loop.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace hapticd {

namespace {

constexpr double tick_s = 1e-3;
constexpr double ramped_up = 0.15;  // of arming: status bits before that are arming's own [s]

// Press, hold, deeper, hold, and back.
HandTarget target(const ClosedLoopSettings& s, double t) {
  const double first = s.press.depth / s.press.speed + s.press.hold,
               second = first + s.deeper / s.press.speed + s.press.hold;
  Press deeper = s.press, whole = s.press;
  deeper.start = s.press.start + s.press.depth * s.press.direction;
  deeper.depth = s.deeper;
  whole.depth += s.deeper;
  whole.hold = second - whole.depth / whole.speed;
  HandTarget at = t < first    ? target_at(s.press, t)
                  : t < second ? target_at(deeper, t - first)
                               : target_at(whole, t);
  if (s.sway) at.x += s.sway(t);
  return at;
}

struct Plateau {
  double depth = 0, force = 0, swing = 0, turning = 0;
};

// The last half of the hold that ends at `end`.
Plateau plateau(const std::vector<ClosedLoopTick>& ticks, double end, double hold) {
  Plateau p;
  double low = 1e300, high = -1e300, least = 1e300, most = -1e300;
  int n = 0;
  for (const ClosedLoopTick& tick : ticks) {
    if (tick.t < end - hold / 2 || tick.t >= end) continue;
    low = std::min(low, tick.depth);
    high = std::max(high, tick.depth);
    least = std::min(least, tick.turn);
    most = std::max(most, tick.turn);
    p.depth += tick.depth;
    p.force += tick.force;
    ++n;
  }
  if (n == 0) return p;
  p.depth /= n;
  p.force /= n;
  p.swing = high - low;
  p.turning = most - least;
  return p;
}

// States on their way to the renderer.
class Network {
 public:
  explicit Network(const ClosedLoopSettings& s) : settings_(s) {}

  void send(std::int64_t i, const DeviceSample& sample) {
    const int ticks = settings_.underway ? settings_.underway(i) : 0;
    if (ticks >= 0) way_.push_back({i + ticks, sample});
  }
  // What has arrived by tick i, the last of it.
  const DeviceSample* receive(std::int64_t i) {
    const auto due =
        std::stable_partition(way_.begin(), way_.end(), [&](const Sent& s) { return s.due <= i; });
    if (due == way_.begin()) return nullptr;
    newest_ = std::prev(due)->sample;  // all that is due became so in this tick
    way_.erase(way_.begin(), due);
    if (settings_.renumbered) newest_.sequence = ++arrived_;
    return &newest_;
  }

 private:
  struct Sent {
    std::int64_t due;
    DeviceSample sample;
  };
  const ClosedLoopSettings& settings_;
  std::vector<Sent> way_;
  DeviceSample newest_;
  std::uint64_t arrived_ = 0;
};

Quat turned(const Vec3& by, const Quat& q) {
  const double angle = by.norm();
  if (!(angle > 0)) return q;
  return (Quat(Eigen::AngleAxisd(angle, by / angle)) * q).normalized();
}

}  // namespace

ClosedLoopResult run_closed_loop(Renderer& renderer, const ClosedLoopSettings& s) {
  check(s.hand);
  if (s.turning) check(*s.turning);
  ClosedLoopResult result;
  const double first = s.press.depth / s.press.speed + s.press.hold,
               second = first + s.deeper / s.press.speed + s.press.hold;
  const double out = s.let_go ? (s.press.depth + s.deeper) / s.press.speed : 0;
  const auto ticks = static_cast<std::int64_t>(std::lround((s.arm + second + out) / tick_s));
  HandState hand, turn;
  hand.x = s.press.start;
  const Vec3 zero = s.encoder_zero * s.press.direction;
  Network network(s);
  ForceDelay delay(s.hand.delay), torque_delay(s.hand.delay);
  double energy = 0, dissipated = 0, waiting = 0;  // waiting: the device's damping of a tick without a force
  Vec3 before = Vec3::Zero();
  for (std::int64_t i = 0; i < ticks; ++i) {
    const double t = tick_s * static_cast<double>(i) - s.arm;
    const std::int64_t ns = 1'000'000 * i;
    DeviceSample sample;
    sample.sequence = static_cast<std::uint64_t>(i) + 1;
    sample.pose = {quantised(hand.x - zero, s.hand.quantum) + zero,
                   turned(s.turning ? quantised(turn.x, s.turning->quantum) : turn.x, s.orientation)};
    sample.enable = true;
    sample.buttons = s.buttons ? s.buttons(t) : 0;
    network.send(i, sample);
    const ForceSample answer = renderer.tick(network.receive(i));
    if (!answer.force.allFinite() || !answer.torque.allFinite() || !hand.x.allFinite()) {
      result.finite = false;
      return result;
    }
    delay.push(ns, answer.force);
    torque_delay.push(ns, answer.torque);
    result.ticks.push_back({t, (hand.x - s.press.start).dot(s.press.direction),
                            -answer.force.dot(s.press.direction), answer.force.norm(),
                            (answer.force - before).norm(), answer.torque.norm(), turn.x.norm(), energy,
                            answer.step, answer.status});
    if (t > ramped_up - s.arm) {
      result.status |= answer.status;
      result.force_max = std::max(result.force_max, answer.force.norm());
      result.force_step_max = std::max(result.force_step_max, (answer.force - before).norm());
    }
    before = answer.force;
    const double h = tick_s / s.substeps;
    for (int k = 0; k < s.substeps; ++k) {
      const double part = static_cast<double>(k) / s.substeps;
      const std::int64_t now = ns + static_cast<std::int64_t>(1e6 * part);
      const Vec3 pushed = saturated(delay.at(now), s.hand.saturation);
      const Vec3 force = s.guided ? Vec3(pushed.dot(s.press.direction) * s.press.direction) : pushed;
      const Vec3 torque = s.turning ? saturated(torque_delay.at(now), s.turning->saturation) : Vec3::Zero();
      const Vec3 x = hand.x, angle = turn.x;
      hand = advanced(s.hand, hand, target(s, std::max(0.0, t + tick_s * part)), force, h);
      if (s.turning) turn = advanced(*s.turning, turn, {}, torque, h);
      energy -= force.dot(hand.x - x) + torque.dot(turn.x - angle);
      double damped = h * s.hand.device_damping * hand.v.squaredNorm();
      if (s.turning) damped += h * s.turning->device_damping * turn.v.squaredNorm();
      const bool pushes = force != Vec3::Zero() || torque != Vec3::Zero();
      if (pushes)
        dissipated += damped + std::exchange(waiting, 0);
      else
        waiting = damped + (k == 0 ? 0 : waiting);
      if (s.taken_elsewhere) continue;
      result.energy_min = std::min(result.energy_min, energy);
      result.surplus_min = std::min(result.surplus_min, energy + dissipated);
    }
    // Of several hands only what all of them have put in by the end of a tick counts.
    if (!s.taken_elsewhere) continue;
    const double all = energy + s.taken_elsewhere();
    result.energy_min = std::min(result.energy_min, all);
    result.surplus_min = std::min(result.surplus_min, all + dissipated);
  }
  result.surplus_end = energy + dissipated + (s.taken_elsewhere ? s.taken_elsewhere() : 0);
  const Plateau one = plateau(result.ticks, first, s.press.hold),
                two = plateau(result.ticks, second, s.press.hold);
  result.swing = std::max(one.swing, two.swing);
  result.turning = std::max(one.turning, two.turning);
  result.force = two.force;
  if (two.depth > one.depth) result.stiffness = (two.force - one.force) / (two.depth - one.depth);
  return result;
}

}  // namespace hapticd
