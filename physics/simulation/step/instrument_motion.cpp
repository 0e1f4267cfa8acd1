#include "physics/simulation/step/instrument_motion.h"

#include <algorithm>

namespace hapticd {
namespace {

constexpr double least_elapsed = 0.1;  // of h, between two samples whose times are known

}  // namespace

void InstrumentMotion::follow(const InstrumentSample& sample, double h) {
  const bool known = sample.present && present_;
  const bool timed = sample.time > 0 && time_ > 0;
  const double elapsed = timed ? std::max(sample.time - time_, least_elapsed * h) : h;
  way_ = known ? difference(sample.pose, pose_) : Vec6::Zero();
  twist_ = way_ / elapsed;
  if (!known) predictor_.forget();
  if (sample.present) predictor_.follow(sample.pose.p);
  pose_ = sample.pose;
  time_ = sample.time;
  present_ = sample.present;
}

bool InstrumentMotion::is_at(const Pose& X) const noexcept {
  return present_ && X.p == pose_.p && X.q.coeffs() == pose_.q.coeffs();
}

}  // namespace hapticd
