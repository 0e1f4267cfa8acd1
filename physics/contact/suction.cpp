#include "physics/contact/suction.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "physics/contact/placed_instrument.h"

namespace hapticd {
namespace {

constexpr double full_at = 0.9;             // of its area covered, a port is
constexpr double inner = 0.8, outer = 1.2;  // radii between which ψ falls

// 1 up to a, 0 from b on.
double falling(double v, double a, double b) noexcept { return std::clamp((b - v) / (b - a), 0.0, 1.0); }

// x_free += s C_pp pull
void shift(double s, CondensedProblem& problem) noexcept {
  const Eigen::Map<const MatX> C = std::as_const(problem).C();
  for (int n = 0; n < problem.nodes; ++n) {
    if (problem.pull[n].isZero(0)) continue;
    const Vec3 f = s * problem.column_scale[n] * problem.pull[n];
    for (int k = 0; k < problem.nodes; ++k) problem.x_free[k] += C.block<3, 3>(3 * k, 3 * n) * f;
  }
}

bool on_one_face(const PatchSample& a, const PatchSample& b) noexcept { return a.node == b.node; }

}  // namespace

Suction suction_of(const CondensedProblem& problem, const Instrument& shape, const Pose& X,
                   const PatchPositions& x, double vacuum, PatchPositions& pull, Grip* grip,
                   double share) noexcept {
  Suction s;
  const Port& port = shape.port;
  if (port.radius <= 0) return s;
  const PlacedInstrument placed(shape, X);
  const Vec3 centre = X.to_world(port.position), d = X.q * port.direction;
  const double area = std::numbers::pi * port.radius * port.radius;
  const double far = outer * port.radius + port.reach;
  const auto covers = [&](const Vec3& at) {
    const Vec3 from = at - centre;
    if (from.squaredNorm() > far * far) return 0.0;
    const double along = from.dot(d), radial = (from - along * d).norm();
    const double inside = falling(radial, inner * port.radius, outer * port.radius);
    return inside > 0 ? inside * falling(placed.gap(at).distance, 0.5 * port.reach, port.reach) : 0.0;
  };
  std::array<double, max_patch_samples> weight;
  double sum = 0;
  for (int first = 0, end = 0; first < problem.samples; first = end) {
    const PatchSample& of = problem.sample[first];
    for (end = first + 1; end < problem.samples && on_one_face(of, problem.sample[end]);) ++end;
    std::fill(weight.begin() + first, weight.begin() + end, 0.0);
    if (of.node[0] < 0) continue;
    double face = -1;  // a sample's share of it; known when needed
    for (int k = first; k < end; ++k) {
      double held = covers(sample_position(problem, x, k));
      if (grip) held = (*grip)[k] = held > 0 ? (*grip)[k] + share * (held - (*grip)[k]) : 0;
      if (held <= 0) continue;
      if (face < 0)
        face =
            0.5 * (x[of.node[1]] - x[of.node[0]]).cross(x[of.node[2]] - x[of.node[0]]).norm() / (end - first);
      weight[k] = face * held;
      sum += weight[k];
    }
  }
  if (sum <= 0) return s;
  s.occlusion = std::min(1.0, sum / (full_at * area));
  const Vec3 whole = -vacuum * area * s.occlusion * d;
  for (int k = 0; k < problem.samples; ++k) {
    if (problem.sample[k].node[0] < 0 || weight[k] <= 0) continue;
    const PatchSample& sample = problem.sample[k];
    const Vec3 f = weight[k] / sum * whole;
    for (int c = 0; c < 3; ++c) pull[sample.node[c]] += sample.weight[c] * f;
    s.load.head<3>() -= f;
    s.load.tail<3>() -= (sample_position(problem, x, k) - X.p).cross(f);
  }
  return s;
}

double pumped(const Port& port, double vacuum, double occlusion, bool on, double period) noexcept {
  if (port.radius <= 0) return 0;
  const double target = on ? port.vacuum * occlusion : 0;
  if (port.rise_time <= 0) return target;
  const double step = period / port.rise_time;
  if (on && port.flow > 0)
    return std::min(port.vacuum, (vacuum + step * target) / (1 + step * (1 - occlusion)));
  return (vacuum + step * target) / (1 + step);
}

EachInstrument<double> apply_suction(Instruments instruments, const InstrumentPoses& X,
                                     const InstrumentPoses& X_next, const PatchPositions& x,
                                     const EachInstrument<double>& vacuum, CondensedProblem& problem,
                                     EachInstrument<Grip>* grip, double share) noexcept {
  EachInstrument<double> occlusion;
  std::fill_n(problem.pull.begin(), problem.nodes, Vec3::Zero());
  for (int i = 0; i < instruments.count(); ++i) {
    problem.instrument[i].load.setZero();
    if (!X.present[i] && grip) (*grip)[i].fill(0);
    if (!X.present[i] || instruments[i].port.radius <= 0) continue;
    const Suction s = suction_of(problem, instruments[i], X[i], x, vacuum[i], problem.pull,
                                 grip ? &(*grip)[i] : nullptr, share);
    occlusion[i] = s.occlusion;
    problem.instrument[i].load = s.load;
    problem.instrument[i].way = difference(X_next[i], X[i]);
  }
  shift(1, problem);
  return occlusion;
}

bool let_go(const CondensedProblem& problem, Instruments instruments, const PatchPositions& before,
            const PatchPositions& x, EachInstrument<Grip>& grip) noexcept {
  bool any = false;
  for (int i = 0; i < instruments.count(); ++i) {
    const Port& port = instruments[i].port;
    if (port.radius <= 0) continue;
    const double most = 2 * port.radius + port.reach;
    for (int k = 0; k < problem.samples; ++k) {
      if (!(grip[i][k] > 0)) continue;
      const double way = (sample_position(problem, x, k) - sample_position(problem, before, k)).norm();
      if (way <= most) continue;
      grip[i][k] = 0;
      any = true;
    }
  }
  return any;
}

void remove_suction(CondensedProblem& problem) noexcept {
  shift(-1, problem);
  std::fill_n(problem.pull.begin(), problem.nodes, Vec3::Zero());
  for (InstrumentReference& of : problem.instrument.value) of.load.setZero();
}

bool any_port(Instruments instruments) noexcept {
  for (int i = 0; i < instruments.count(); ++i)
    if (instruments[i].port.radius > 0) return true;
  return false;
}

}  // namespace hapticd
