// How the instrument moves, from the samples that steps begin with.
//
//   twist = (X ⊖ X_before) / elapsed      elapsed: between the samples, no less than 0.1 h; h where unknown
//
// Steps of a simulation that others starve are farther apart than h, and simulated time then stands still.
// Units: m, rad, s. Guarantee: wait-free, no allocation.
#pragma once

#include "physics/contact/instruments.h"
#include "physics/simulation/step/pose_predictor.h"

namespace hapticd {

// What the simulation knows of the device at one instant, already in the scene.
struct InstrumentSample {
  Pose pose;
  bool present = false;  // no device: no contact, no removal
  bool phaco = false;
  bool aspiration = false;
  double time = 0;    // when that was, on any one clock [s]; 0: a step after the sample before
  double vacuum = 0;  // of its pump [Pa]
};

// Of all instruments of a world; one converts.
using InstrumentSamples = EachInstrument<InstrumentSample>;

// Where those are that are present.
InstrumentPoses poses_of(const InstrumentSamples& samples) noexcept;
inline bool any_present(const InstrumentSamples& samples) noexcept { return poses_of(samples).any(); }

class InstrumentMotion {
 public:
  // Once in a step.
  void follow(const InstrumentSample& sample, double h);

  bool present() const noexcept { return present_; }
  const Pose& pose() const noexcept { return pose_; }    // of the newest sample
  const Vec6& way() const noexcept { return way_; }      // from the sample before; zero where that is unknown
  const Vec6& twist() const noexcept { return twist_; }  // as a displacement per second
  const PosePredictor& predictor() const noexcept { return predictor_; }

  // The newest sample was at this very pose.
  bool is_at(const InstrumentSample& sample) const noexcept;

 private:
  Pose pose_;
  Vec6 way_ = Vec6::Zero();
  Vec6 twist_ = Vec6::Zero();
  PosePredictor predictor_;
  double time_ = 0;  // [s]
  bool present_ = false;
};

// How each moves.
class InstrumentMotions {
 public:
  void follow(const InstrumentSamples& samples, double h);

  const InstrumentMotion& operator[](int i) const noexcept { return motion_[i]; }
  InstrumentPoses poses() const noexcept;  // of the newest samples
  EachInstrument<Vec6> way() const noexcept;
  EachInstrument<Vec6> twist() const noexcept;
  // The newest samples were at these very poses.
  bool are_at(const InstrumentSamples& samples) const noexcept;

 private:
  EachInstrument<InstrumentMotion> motion_;
};

}  // namespace hapticd
