#include "physics/simulation/step/energy_bound.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "physics/tissue/stored_energy.h"

namespace hapticd {
namespace {

constexpr int most_halvings = 12;
constexpr int chords = 3;
constexpr double solve_error = 1e-9;  // of the energies that are summed: what C's rounding makes of them

// What the bound is of, one entry a piece.
class Bounding {
 public:
  Bounding(const TissueModel& model, const TissueState& state, const Pieces& pieces, const VecX& elastic,
           const VecX& dx, const VecX& f, double h)
      : model_(model), state_(state), pieces_(pieces), f_(f), h_(h) {
    const VecX before = elastic + kinetic([&](int n) { return Vec3(h * state.v[n]); });
    scale_ = before + work(dx).cwiseAbs() + strain_of_rounding();
    allowed_ = before + solve_error * scale_;
  }

  struct End {
    VecX elastic, excess;
    bool holds(int p) const { return excess[p] <= 0; }  // not of what is no number
  };
  End after(const VecX& dx) const {
    End end;
    end.elastic.resize(pieces_.count());
    stored_energies(model_, state_, pieces_, dx, end.elastic);
    end.excess = kinetic([&](int n) { return Vec3(dx.segment<3>(3 * n)); }) - work(dx) + end.elastic - allowed_;
    return end;
  }
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
    for (int n = 0; n < model_.node_count(); ++n)
      if (pieces_.of_node[n] >= 0 && !model_.fixed[n]) visit(n, pieces_.of_node[n]);
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
    VecX volume = VecX::Zero(pieces_.count());
    for (int t = 0; t < model_.tet_count(); ++t)
      if (pieces_.of_tet[t] >= 0) volume[pieces_.of_tet[t]] += model_.volume[t];
    return to_scale * strain * strain * (2 * model_.material.mu() + model_.material.lambda()) * volume;
  }

  const TissueModel& model_;
  const TissueState& state_;
  const Pieces& pieces_;
  const VecX& f_;
  const double h_;
  VecX scale_, allowed_;
};

}  // namespace

double kinetic_energy(const TissueModel& model, const TissueState& state) noexcept {
  double sum = 0;
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n]) sum += state.mass[n] * state.v[n].squaredNorm();
  return 0.5 * sum;
}

EnergyBound bound_energy(const TissueModel& model, const TissueState& state, const Pieces& pieces,
                         const VecX& elastic, VecX& dx, const VecX& f, double h) {
  const Bounding bounding(model, state, pieces, elastic, dx, f, h);
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
  VecX least = VecX::Ones(pieces.count()), most = least;  // θ: what holds, and what does not
  for (const int p : making) least[p] = 0;
  const auto motion = [&](const VecX& share) {
    VecX part = whole;
    bounding.each_node([&](int n, int p) {
      if (share[p] == 0)
        part.segment<3>(3 * n) = base.segment<3>(3 * n);
      else if (share[p] < 1)
        part.segment<3>(3 * n) = base.segment<3>(3 * n) + share[p] * (whole - base).segment<3>(3 * n);
    });
    return part;
  };
  Bounding::End kept = bounding.after(motion(least));
  bounding.each_node([&](int n, int p) {
    if (least[p] == 0 && !kept.holds(p)) base.segment<3>(3 * n).setZero();
  });
  for (const int p : making)
    if (!kept.holds(p)) {
      kept.elastic[p] = elastic[p];
      kept.excess[p] = 0;
    }
  const auto try_shares = [&](const VecX& share) {
    const Bounding::End next = bounding.after(motion(share));
    for (const int p : making) {
      if (share[p] == least[p]) continue;
      Bounding::End& end = next.holds(p) ? kept : over;
      (next.holds(p) ? least : most)[p] = share[p];
      end.elastic[p] = next.elastic[p];
      end.excess[p] = next.excess[p];
    }
  };
  for (int k = 0; k < most_halvings && (least.array() == 0).any(); ++k)
    try_shares((least.array() == 0).select(0.5 * most, least));
  // The excess is convex where E is, so a chord ends below it: a small excess costs a small part of the
  // motion.
  for (int k = 0; k < chords && (least.array() > 0).any(); ++k) {
    VecX share = least;
    for (const int p : making)
      if (least[p] > 0) share[p] += (most[p] - least[p]) * kept.excess[p] / (kept.excess[p] - over.excess[p]);
    try_shares(share);
  }
  dx = motion(least);
  bound.share = least.minCoeff();
  bound.elastic = std::move(kept.elastic);
  return bound;
}

}  // namespace hapticd
