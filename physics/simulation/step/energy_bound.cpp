#include "physics/simulation/step/energy_bound.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "physics/tissue/stored_energy.h"

// Why the largest θ that keeps the bound is not always good. With Δ = θ Δx and v⁺ = Δ/h, Φ' = 0 says
//
//   (M (v⁺ − v)/h + ∇E(x + Δ) − f)ᵀ Δ = 0
//
// and where E is convex along the motion, E(x + Δ) − E(x) ≤ ∇E(x + Δ)ᵀ Δ. Together:
//
//   H(x + Δ, v⁺) ≤ H(x, v) + fᵀΔ − ½ ‖v⁺ − v‖²_M
//
// so the bound holds at the lowest Φ, and with it the loss that implicit Euler has. The largest θ may lose
// nothing: a soft body whose steps go more than twice too far would go to and fro between two states of equal
// energy, and no damping would ever bring it to rest. A motion that is right but for a small excess has its
// lowest Φ near there, and keeps the largest θ: a free block that spins loses no more than its excess. Where
// contact acts, Δx is also what keeps gaps open, and each part of it that is not kept is penetration, which
// the next step makes energy of: there the largest θ is always taken.
namespace hapticd {
namespace {

constexpr int most_halvings = 12;
constexpr int chords = 3;
constexpr double enough = 0.5;        // of what Φ can lose along a motion
constexpr double solve_error = 1e-9;  // of the energies that are summed: what C's rounding makes of them

// What the bound is of, one entry a piece.
class Bounding {
 public:
  Bounding(const TissueModel& model, const TissueState& state, const Pieces& pieces, const VecX& elastic,
           const VecX& dx, const BodyForces& forces, double h)
      : model_(model),
        state_(state),
        pieces_(pieces),
        f_(forces.external + forces.contact),
        h_(h),
        touched_(pieces.held.size(), 0) {
    each_node([&](int n, int p) { touched_[p] |= !forces.contact.segment<3>(3 * n).isZero(0); });
    none_.elastic = elastic;
    none_.potential = elastic + kinetic([&](int n) { return Vec3(h * state.v[n]); });
    scale_ = none_.potential + work(dx).cwiseAbs() + strain_of_rounding();
    none_.excess = -solve_error * scale_;
    allowed_ = none_.potential - none_.excess;
  }

  struct End {
    VecX elastic, excess, potential;                    // E, what H is above its bound, Φ
    bool holds(int p) const { return excess[p] <= 0; }  // not of a NaN
    void take(const End& other, int p) {
      elastic[p] = other.elastic[p];
      excess[p] = other.excess[p];
      potential[p] = other.potential[p];
    }
  };
  End after(const VecX& dx) const {
    End end;
    end.elastic.resize(pieces_.count());
    stored_energies(model_, state_, pieces_, dx, end.elastic);
    const VecX unmoving = end.elastic - work(dx);
    end.excess = unmoving + kinetic([&](int n) { return Vec3(dx.segment<3>(3 * n)); }) - allowed_;
    end.potential = unmoving + kinetic([&](int n) { return Vec3(dx.segment<3>(3 * n) - h_ * state_.v[n]); });
    return end;
  }
  // Of no motion at all, v⁺ = 0.
  const End& after_none() const { return none_; }
  bool touched(int p) const { return touched_[p]; }
  double relative(const VecX& excess, int p) const { return excess[p] / scale_[p]; }

  // The mean motion of each piece that nothing holds: it is the forces' own. Of one that is held: none.
  VecX mean_motion(const VecX& dx) const {
    const int count = pieces_.count();
    VecX sum = VecX::Zero(3 * count), mass = VecX::Zero(count), mean = VecX::Zero(dx.size());
    each_node([&](int n, int p) {
      sum.segment<3>(3 * p) += state_.mass[n] * dx.segment<3>(3 * n);
      mass[p] += state_.mass[n];
    });
    each_node([&](int n, int p) {
      if (!pieces_.held[p] && mass[p] > 0) mean.segment<3>(3 * n) = sum.segment<3>(3 * p) / mass[p];
    });
    return mean;
  }

  // visit(node, piece) of the nodes that move.
  template <typename Visit>
  void each_node(const Visit& visit) const {
    model_.each_node([&](int n) {
      if (pieces_.of_node[n] >= 0 && !model_.fixed[n]) visit(n, pieces_.of_node[n]);
    });
  }

 private:
  template <typename Motion>
  VecX kinetic(const Motion& motion) const {
    VecX sum = VecX::Zero(pieces_.count());
    each_node([&](int n, int p) { sum[p] += 0.5 * state_.mass[n] * motion(n).squaredNorm() / (h_ * h_); });
    return sum;
  }
  VecX work(const VecX& dx) const {
    VecX sum = VecX::Zero(pieces_.count());
    each_node([&](int n, int p) { sum[p] += f_.segment<3>(3 * n).dot(dx.segment<3>(3 * n)); });
    return sum;
  }
  // The energy of a strain that is nothing but rounding: at rest there is no other scale [J].
  VecX strain_of_rounding() const {
    constexpr double strain = 1e-9, to_scale = 1 / solve_error;
    VecX stiff_volume = VecX::Zero(pieces_.count());
    model_.each_tet([&](int t) {
      if (pieces_.of_tet[t] >= 0)
        stiff_volume[pieces_.of_tet[t]] +=
            (2 * model_.elastic[t].mu + model_.elastic[t].lambda) * model_.volume[t];
    });
    return to_scale * strain * strain * stiff_volume;
  }

  const TissueModel& model_;
  const TissueState& state_;
  const Pieces& pieces_;
  const VecX f_;
  const double h_;
  std::vector<char> touched_;  // by contact
  VecX scale_, allowed_;
  End none_;
};

}  // namespace

double kinetic_energy(const TissueModel& model, const TissueState& state) noexcept {
  double sum = 0;
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n]) sum += state.mass[n] * state.v[n].squaredNorm();
  return 0.5 * sum;
}

EnergyBound bound_energy(const TissueModel& model, const TissueState& state, const Pieces& pieces,
                         const VecX& elastic, VecX& dx, const BodyForces& forces, double h) {
  const Bounding bounding(model, state, pieces, elastic, dx, forces, h);
  Bounding::End over = bounding.after(dx);
  EnergyBound bound;
  std::vector<int> making;
  for (int p = 0; p < pieces.count(); ++p)
    if (!over.holds(p)) {
      making.push_back(p);
      bound.made = std::isfinite(over.excess[p]) ? std::max(bound.made, bounding.relative(over.excess, p))
                                                 : std::numeric_limits<double>::infinity();
    }
  if (making.empty()) {
    bound.elastic = std::move(over.elastic);
    return bound;
  }

  // Of a piece that makes energy base + θ (Δx − base) is kept; base: its mean motion, or nothing if even that
  // is too much.
  const VecX whole = dx;
  VecX base = bounding.mean_motion(whole);
  VecX share = VecX::Ones(pieces.count());
  for (const int p : making) share[p] = 0;
  const auto motion = [&](const VecX& theta) {
    VecX part = whole;
    bounding.each_node([&](int n, int p) {
      if (theta[p] == 0)
        part.segment<3>(3 * n) = base.segment<3>(3 * n);
      else if (theta[p] < 1)
        part.segment<3>(3 * n) = base.segment<3>(3 * n) + theta[p] * (whole - base).segment<3>(3 * n);
    });
    return part;
  };
  Bounding::End kept = bounding.after(motion(share));
  bounding.each_node([&](int n, int p) {
    if (share[p] == 0 && !kept.holds(p)) base.segment<3>(3 * n).setZero();
  });
  for (const int p : making)
    if (!kept.holds(p)) kept.take(bounding.after_none(), p);
  const Bounding::End at_base = kept;

  VecX most = VecX::Ones(pieces.count());  // θ of `over`, as share is of `kept`
  const auto try_shares = [&](const VecX& theta) {
    const Bounding::End next = bounding.after(motion(theta));
    for (const int p : making) {
      if (theta[p] == share[p]) continue;
      (next.holds(p) ? kept : over).take(next, p);
      (next.holds(p) ? share : most)[p] = theta[p];
    }
  };
  for (int k = 0; k < most_halvings && (share.array() == 0).any(); ++k)
    try_shares((share.array() == 0).select(0.5 * most, share));
  // The excess is convex where E is, so a chord ends below it: a small excess costs a small part of the
  // motion.
  for (int k = 0; k < chords && (share.array() > 0).any(); ++k) {
    VecX theta = share;
    for (const int p : making)
      if (share[p] > 0) theta[p] += (most[p] - share[p]) * kept.excess[p] / (kept.excess[p] - over.excess[p]);
    try_shares(theta);
  }

  // Φ at the half of that, and at the vertex of the parabola through all three.
  VecX half = share, vertex = share;
  for (const int p : making)
    if (!bounding.touched(p)) half[p] *= 0.5;
  const Bounding::End at_half = bounding.after(motion(half));
  for (const int p : making) {
    const double first = at_half.potential[p] - at_base.potential[p];
    const double second = kept.potential[p] - at_half.potential[p];
    if (!bounding.touched(p) && second > first)
      vertex[p] = half[p] * std::clamp(0.5 - first / (second - first), 0.0, 2.0);
  }
  const Bounding::End at_vertex = bounding.after(motion(vertex));
  for (const int p : making) {
    if (bounding.touched(p)) continue;
    const double base_potential = at_base.potential[p], lost = base_potential - kept.potential[p];
    double best = 0;
    const Bounding::End* end = &at_base;
    for (const auto& [theta, at] : {std::pair(half[p], &at_half), std::pair(vertex[p], &at_vertex)})
      if (at->holds(p) && at->potential[p] < end->potential[p]) {
        best = theta;
        end = at;
      }
    if (lost >= enough * (base_potential - end->potential[p])) continue;
    share[p] = best;
    kept.take(*end, p);
  }
  dx = motion(share);
  bound.share = share.minCoeff();
  bound.elastic = std::move(kept.elastic);
  return bound;
}

}  // namespace hapticd
