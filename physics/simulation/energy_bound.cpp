#include "physics/simulation/energy_bound.h"

#include <cmath>

#include "physics/tissue/stored_energy.h"

namespace hapticd {
namespace {

constexpr int most_halvings = 12;
constexpr int chords = 3;
constexpr double solve_error = 1e-9;  // of the energies that are summed: what C's rounding makes of them

double kinetic_energy_of(const TissueModel& model, const TissueState& state, const VecX& dx,
                         double h) noexcept {
  double sum = 0;
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n]) sum += state.mass[n] * dx.segment<3>(3 * n).squaredNorm();
  return 0.5 * sum / (h * h);
}

// The energy of a strain that is nothing but rounding: at rest there is no other scale [J].
double strain_of_rounding(const TissueModel& model) noexcept {
  constexpr double strain = 1e-9, to_scale = 1 / solve_error;
  double volume = 0;
  for (const double v : model.volume) volume += v;
  return to_scale * strain * strain * volume * (2 * model.material.mu() + model.material.lambda());
}

// The mean motion of a body that nothing holds: it is the forces' own. Of one that is held: none.
Vec3 mean_motion(const TissueModel& model, const TissueState& state, const VecX& dx) noexcept {
  Vec3 sum = Vec3::Zero();
  double mass = 0;
  for (int n = 0; n < model.node_count(); ++n) {
    if (state.live_tets_of_node[n] == 0) continue;
    if (model.fixed[n]) return Vec3::Zero();
    sum += state.mass[n] * dx.segment<3>(3 * n);
    mass += state.mass[n];
  }
  return mass > 0 ? Vec3(sum / mass) : Vec3::Zero();
}

// What is kept of a motion about another: base + θ (Δx − base).
class Bounding {
 public:
  Bounding(const TissueModel& model, const TissueState& state, const VecX& base, const VecX& dx,
           const VecX& f, double h, double allowed)
      : model_(model),
        state_(state),
        base_(base),
        rest_(dx - base),
        base_energy_(kinetic_energy_of(model, state, base, h) - f.dot(base) - allowed),
        moving_(kinetic_energy_of(model, state, rest_, h)),
        work_(f.dot(rest_)) {}

  struct Kept {
    double share, elastic, excess;
    bool holds() const { return excess <= 0; }
  };
  VecX motion(double share) const { return base_ + share * rest_; }
  Kept at(double share) const {
    const double elastic = stored_energy(model_, state_, motion(share));
    return {share, elastic, base_energy_ + share * (share * moving_ - work_) + elastic};
  }

 private:
  const TissueModel& model_;
  const TissueState& state_;
  VecX base_, rest_;
  double base_energy_, moving_, work_;
};

}  // namespace

double kinetic_energy(const TissueModel& model, const TissueState& state) noexcept {
  double sum = 0;
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n]) sum += state.mass[n] * state.v[n].squaredNorm();
  return 0.5 * sum;
}

EnergyBound bound_energy(const TissueModel& model, const TissueState& state, double elastic, VecX& dx,
                         const VecX& f, double h) {
  const double before = kinetic_energy(model, state) + elastic,
               scale = before + std::abs(f.dot(dx)) + strain_of_rounding(model),
               allowed = before + solve_error * scale;
  VecX base = VecX::Zero(dx.size());
  const Bounding about_rest(model, state, base, dx, f, h, allowed);
  auto over = about_rest.at(1);
  if (over.holds()) return {1, over.elastic, 0};
  const double made = over.excess / scale;
  const Vec3 mean = mean_motion(model, state, dx);
  for (int n = 0; n < model.node_count(); ++n)
    if (state.live_tets_of_node[n] > 0 && !model.fixed[n]) base.segment<3>(3 * n) = mean;
  const Bounding about_mean(model, state, base, dx, f, h, allowed);
  const Bounding& bounding = about_mean.at(0).holds() ? about_mean : about_rest;
  auto kept = bounding.at(0);
  if (!kept.holds()) kept = {0, elastic, 0};
  for (int k = 0; k < most_halvings && kept.share == 0; ++k) {
    const auto half = bounding.at(0.5 * over.share);
    (half.holds() ? kept : over) = half;
  }
  // The excess is convex where E is, so a chord ends below it: a small excess costs a small part of the
  // motion.
  for (int k = 0; k < chords && kept.share > 0; ++k) {
    const double part = kept.excess / (kept.excess - over.excess);
    const auto next = bounding.at(kept.share + (over.share - kept.share) * part);
    (next.holds() ? kept : over) = next;
  }
  // 0 · NaN is no zero.
  if (kept.share > 0 || &bounding == &about_mean)
    dx = bounding.motion(kept.share);
  else
    dx.setZero();
  return {kept.share, kept.elastic, made};
}

}  // namespace hapticd
