#include "physics/compliance/zone/zone_sample.h"

#include <utility>

namespace hapticd {

void ZoneSample::forget() {
  first_half_.reset();
  sampled_ = {};
  Q_.clear();
}

bool ZoneSample::due_after_update(int age) {
  due_ = ++since_ >= every_ && (age > 1 || every_ <= 1);
  fresh_ = false;
  return due_;
}

void ZoneSample::take(ResidualSample first_half, std::span<const Mat3> Q, int removed) {
  since_ = 0;
  first_half_ = std::move(first_half);
  Q_.assign(Q.begin(), Q.end());
  removed_ = removed;
}

const SampledError& ZoneSample::error(Compliance& compliance) {
  if (first_half_ && !due_) {
    sampled_ = error_of(compliance, *std::exchange(first_half_, std::nullopt));
  } else if (due_ && !fresh_) {
    if (every_ <= 1) sampled_ = error_of(compliance, *std::exchange(first_half_, std::nullopt));
    fresh_ = true;
  }
  return sampled_;
}

bool ZoneSample::holds(std::span<const Mat3> Q, int removed) const {
  if (first_half_) return false;
  if (fresh_) return true;
  if (Q_.size() != Q.size() || removed_ != removed) return false;
  for (std::size_t n = 0; n < Q.size(); ++n)
    if (!((Q[n] - Q_[n]).squaredNorm() < still_ * still_)) return false;
  return true;
}

}  // namespace hapticd
