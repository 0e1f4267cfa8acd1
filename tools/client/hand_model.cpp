#include "tools/client/hand_model.h"

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace hapticd {

void check(const HandSettings& hand) {
  if (!(hand.mass > 0)) throw std::invalid_argument("the hand's mass must be positive");
  for (const double value : {hand.stiffness, hand.damping, hand.device_damping, hand.friction, hand.quantum,
                             hand.delay, hand.saturation})
    if (!(value >= 0) || !std::isfinite(value))
      throw std::invalid_argument(
          "the hand's stiffness, damping, friction, quantum, delay and saturation "
          "must be finite and not negative");
  if (hand.delay > 0.5) throw std::invalid_argument("a force delay above 0.5 s is not supported");
}

HandState advanced(const HandSettings& hand, HandState state, const HandTarget& target, const Vec3& force,
                   double h) noexcept {
  const Vec3 push = hand.stiffness * (target.x - state.x) + hand.damping * target.v + force;
  Vec3 v = (state.v + h / hand.mass * push) / (1 + h / hand.mass * (hand.damping + hand.device_damping));
  const double speed = v.norm();
  const double stop = hand.friction * h / hand.mass;
  v *= speed > stop ? 1 - stop / speed : 0.0;
  state.v = v;
  state.x += h * v;
  return state;
}

Vec3 quantised(const Vec3& x, double quantum) noexcept {
  if (quantum <= 0) return x;
  return (x / quantum).array().round().matrix() * quantum;
}

Vec3 saturated(const Vec3& force, double limit) noexcept {
  const double size = force.norm();
  return limit > 0 && size > limit ? Vec3(force * (limit / size)) : force;
}

ForceDelay::ForceDelay(double delay_s) : delay_ns_(std::llround(delay_s * 1e9)) {}

void ForceDelay::push(std::int64_t t_ns, const Vec3& force) noexcept {
  if (end_ - first_ == entry_.size()) present_ = entry_[first_++ % entry_.size()].force;
  entry_[end_++ % entry_.size()] = {t_ns, force};
}

Vec3 ForceDelay::at(std::int64_t t_ns) noexcept {
  while (first_ != end_ && entry_[first_ % entry_.size()].t_ns <= t_ns - delay_ns_)
    present_ = entry_[first_++ % entry_.size()].force;
  return present_;
}

HandTarget target_at(const Press& press, double t) noexcept {
  const double ramp = press.depth / press.speed;
  const double back = ramp + press.hold;
  double depth = 0, rate = 0;
  const auto ease = [&](double s) {
    depth = press.depth * 0.5 * (1 - std::cos(std::numbers::pi * s));
    rate = press.speed * 0.5 * std::numbers::pi * std::sin(std::numbers::pi * s);
  };
  if (t > 0 && t < ramp) {
    ease(t / ramp);
  } else if (t >= ramp && t <= back) {
    depth = press.depth;
  } else if (t > back && t < back + ramp) {
    ease(1 - (t - back) / ramp);
    rate = -rate;
  }
  return {press.start + depth * press.direction, rate * press.direction};
}

}  // namespace hapticd
