#include "tools/stability/bench/two_hand_renderer.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

constexpr double tick_s = 1e-3;
constexpr int substeps = 10;

}  // namespace

TwoHandRenderer::TwoHandRenderer(const Scene& scene, int hand, OtherHand other)
    : hand_(hand), other_(std::move(other)), daemon_(scene) {
  if (other_.grip) {
    check(*other_.grip);
    delay_.emplace(other_.grip->delay);
  }
  held_ = state_.x = other_.at(0);
}

ForceSample TwoHandRenderer::tick(const DeviceSample* arrived) {
  const double t = tick_s * static_cast<double>(count_++);
  sample_.sequence = static_cast<std::uint64_t>(count_);
  sample_.pose.p = other_.grip ? quantised(held_, other_.grip->quantum) : held_;
  sample_.enable = true;
  EachInstrument<const DeviceSample*> states;
  states[hand_] = arrived;
  if (t < other_.silent_from) states[1 - hand_] = &sample_;
  EachInstrument<bool> connected;
  connected[0] = connected[1] = true;
  const EachInstrument<ForceSample> forces = daemon_.tick(states, connected);
  move_other(t, forces[1 - hand_].force);
  past_.push_back({t, held_.z(), taken_});
  return forces[hand_];
}

void TwoHandRenderer::move_other(double t, const Vec3& answer) {
  const Vec3 before = held_;
  Vec3 force = answer;
  if (delay_) {
    const auto ns = std::llround(1e9 * t);
    delay_->push(ns, answer);
    force = delay_->at(ns);
  }
  if (other_.grip) {
    const HandSettings& grip = *other_.grip;
    constexpr double h = tick_s / substeps;
    for (int k = 0; k < substeps; ++k) {
      const double now = t + h * k;
      const HandTarget target{other_.at(now), (other_.at(now + h) - other_.at(now)) / h};
      state_ = advanced(grip, state_, target, force, h);
      if (force != Vec3::Zero()) taken_ += h * grip.device_damping * state_.v.squaredNorm();
    }
    held_ = state_.x;
  } else {
    held_ = other_.at(t + tick_s);
  }
  taken_ -= force.dot(held_ - before);
}

double TwoHandRenderer::taken_since(double t) const {
  const auto at = static_cast<std::size_t>(std::max(0.0, std::ceil(t / tick_s)));
  return at < past_.size() ? taken_ - past_[at].taken : 0;
}

double TwoHandRenderer::swing(double from, double to) const {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Moment& m : past_) {
    if (m.t < from || m.t >= to) continue;
    low = std::min(low, m.height);
    high = std::max(high, m.height);
  }
  return std::max(0.0, high - low);
}

}  // namespace hapticd
