#include "tools/offline/baseline_rendering.h"

#include "haptic/limits.h"

namespace hapticd {

namespace {

constexpr double haptic_period = 1e-3;  // [s]

Vec6 acting_at(const Vec3& force, const Vec3& arm) {
  Vec6 w;
  w.head<3>() = force;
  w.tail<3>() = arm.cross(force);
  return w;
}

// Compliance of one sample along n [m/N].
double compliance_along(const CondensedProblem& problem, const PatchSample& s, const Vec3& n) {
  const auto C = problem.C();
  double c = 0;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b)
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
          c += s.weight[a] * n[i] * C(3 * s.node[a] + i, 3 * s.node[b] + j) * n[j] * s.weight[b];
  return c;
}

}  // namespace

LocalModel::LocalModel(Rendering rendering, Instruments instruments, const ContactOptions& options,
                       double period)
    : rendering_(rendering), instruments_(instruments), options_(options), period_(period) {}

void LocalModel::publish(double t, const CondensedProblem& problem, const ContactSolution& solution) {
  before_ = now_;
  now_ = solution.wrench;
  since_ = t;
  if (rendering_ == Rendering::held || rendering_ == Rendering::extrapolated) return;
  if (!problem_) problem_ = std::make_unique<CondensedProblem>();
  *problem_ = problem;
  if (rendering_ != Rendering::frozen_friction) return;
  InstrumentPoses X_ref;
  for (int i = 0; i < instruments_.count(); ++i) {
    X_ref[i] = problem.instrument[i].X_ref;
    X_ref.present[i] = true;
  }
  const EachInstrument<Vec6> whole =
      solve_contact(problem, instruments_, X_ref, period_, options_, with_friction_, *friction_scratch_)
          .wrench;
  const ContactRows& rows = friction_scratch_->rows;
  std::array<double, max_rows> normal{};
  for (int i = 0; i < rows.contacts; ++i)
    normal[rows.rows_per_contact * i] = friction_scratch_->lambda[rows.rows_per_contact * i];
  const EachInstrument<Vec6> of_normals =
      wrench_on_instruments(rows, {normal.data(), static_cast<std::size_t>(rows.rows())});
  for (int i = 0; i < instruments_.count(); ++i) friction_[i] = whole[i] - of_normals[i];
  for (int k = 0; k < problem_->samples; ++k) problem_->sample[k].friction = 0;
}

Vec6 LocalModel::spring(const Instrument& instrument, const Pose& X) const {
  Gap deepest;
  deepest.distance = 0;
  const PatchSample* sample = nullptr;
  Vec3 place = Vec3::Zero();
  for (int k = 0; k < problem_->samples; ++k) {
    const PatchSample& s = problem_->sample[k];
    if (s.node[0] < 0) continue;
    const Vec3 x = sample_position(*problem_, problem_->x_free, k);
    const Gap gap = gap_at(instrument, X, x);
    if (gap.distance >= deepest.distance || gap.normal.dot(s.outward) > 0.2) continue;
    deepest = gap;
    sample = &s;
    place = x;
  }
  if (!sample) return Vec6::Zero();
  const double compliance = compliance_along(*problem_, *sample, deepest.normal);
  if (!(compliance > 0)) return Vec6::Zero();
  // The normal points from the instrument to the tissue; the instrument is pushed the other way.
  return acting_at(deepest.distance / compliance * deepest.normal, place - X.p);
}

EachInstrument<Vec6> LocalModel::wrench(double t, const InstrumentPoses& X) {
  EachInstrument<Vec6> out;
  switch (rendering_) {
    case Rendering::extrapolated:
      for (int i = 0; i < instruments_.count(); ++i)
        out[i] = now_[i] + (t - since_) / period_ * (now_[i] - before_[i]);
      return out;
    case Rendering::spring:
      for (int i = 0; problem_ && i < instruments_.count(); ++i)
        if (X.present[i]) out[i] = spring(instruments_[i], X[i]);
      return out;
    case Rendering::frozen_friction:
      if (!problem_) return out;
      out = solve_contact(*problem_, instruments_, X, haptic_period, options_, state_, *scratch_).wrench;
      for (int i = 0; i < instruments_.count(); ++i) out[i] += friction_[i];
      return out;
    case Rendering::held:
    case Rendering::solved:
    case Rendering::alone:
      break;
  }
  return now_;
}

ForceSample baseline_answer(const DeviceSettings& device, const Pose& pose, const Vec6& wrench) {
  bool hit = false;
  const Wrench sent = saturated(device, wrench_on_device(device, pose, wrench), hit);
  ForceSample answer;
  answer.force = sent.force;
  answer.torque = sent.torque;
  answer.status = hit ? std::uint32_t{status_saturated} : 0u;
  return answer;
}

}  // namespace hapticd
