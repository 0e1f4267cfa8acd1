// What others do with a 50 Hz contact force at 1 kHz: the baselines that the daemon's rendering is charted
// against.
//
//   held             f(t) = f_k
//   extrapolated     f(t) = f_k + (f_k − f_{k−1}) (t − t_k)/h
//   spring           f(t) = n max(0, −gap(s)) / (nᵀ C_ss n),  s the deepest sample of the free patch at X(t)
//   frozen_friction  f(t) = normal forces solved at X(t) without friction + the step's friction force
//
// f_k, t_k: contact force of the newest problem in use, and since when. Each instrument has its own; friction
// is frozen with all of them in one solve. Forces in scene newtons on the instruments. Source: force
// extrapolation and local models as surveyed by Otaduy and Lin, "High Fidelity Haptic Rendering", 2006.
#pragma once

#include <memory>

#include "tools/offline/offline_run.h"

namespace hapticd {

class LocalModel {
 public:
  // period: of the simulation [s]. The instruments' owner outlives the object.
  LocalModel(Rendering rendering, Instruments instruments, const ContactOptions& options, double period);

  // A problem comes into use at t; `solution` is of the step that made it.
  void publish(double t, const CondensedProblem& problem, const ContactSolution& solution);

  // On the instruments at X: force [N], torque about their origins [N·m].
  EachInstrument<Vec6> wrench(double t, const InstrumentPoses& X);

 private:
  Vec6 spring(const Instrument& instrument, const Pose& X) const;

  Rendering rendering_;
  Instruments instruments_;
  ContactOptions options_;
  double period_;
  double since_ = 0;
  EachInstrument<Vec6> now_, before_, friction_;
  std::unique_ptr<CondensedProblem> problem_;  // frozen_friction: without friction
  ContactState state_, with_friction_;
  std::unique_ptr<ContactScratch> scratch_ = std::make_unique<ContactScratch>();
  std::unique_ptr<ContactScratch> friction_scratch_ = std::make_unique<ContactScratch>();
};

// A baseline's answer to a device at `pose`: in its axes and scale, cut off at its largest force, with none
// of the daemon's watchdogs, blends and slew limits.
ForceSample baseline_answer(const DeviceSettings& device, const Pose& pose, const Vec6& wrench);

}  // namespace hapticd
