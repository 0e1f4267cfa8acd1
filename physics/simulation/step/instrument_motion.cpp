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

bool InstrumentMotion::is_at(const InstrumentSample& sample) const noexcept {
  if (sample.present != present_) return false;
  return !present_ || (sample.pose.p == pose_.p && sample.pose.q.coeffs() == pose_.q.coeffs());
}

InstrumentPoses poses_of(const InstrumentSamples& samples) noexcept {
  InstrumentPoses X;
  for (int i = 0; i < max_instruments; ++i) {
    X[i] = samples[i].pose;
    X.present[i] = samples[i].present;
  }
  return X;
}

void InstrumentMotions::follow(const InstrumentSamples& samples, double h) {
  for (int i = 0; i < max_instruments; ++i) motion_[i].follow(samples[i], h);
}

InstrumentPoses InstrumentMotions::poses() const noexcept {
  InstrumentPoses X;
  for (int i = 0; i < max_instruments; ++i) {
    X[i] = motion_[i].pose();
    X.present[i] = motion_[i].present();
  }
  return X;
}

EachInstrument<Vec6> InstrumentMotions::way() const noexcept {
  EachInstrument<Vec6> way;
  for (int i = 0; i < max_instruments; ++i) way[i] = motion_[i].way();
  return way;
}

EachInstrument<Vec6> InstrumentMotions::twist() const noexcept {
  EachInstrument<Vec6> twist;
  for (int i = 0; i < max_instruments; ++i) twist[i] = motion_[i].twist();
  return twist;
}

bool InstrumentMotions::are_at(const InstrumentSamples& samples) const noexcept {
  for (int i = 0; i < max_instruments; ++i)
    if (!motion_[i].is_at(samples[i])) return false;
  return true;
}

}  // namespace hapticd
