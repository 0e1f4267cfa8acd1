// The forces of all sides of a node together move it as they did while it was whole: tissue is taken to be in
// balance with its inertia, its damping and what loads it. Once it is parted, side c is out of balance by
// g_c, with which the others held it; Σ_c g_c = 0. Conjugate gradients add ½ α rᵀz ≥ 0 to what is released
// with every step, so wherever they stop, −Π(u) is a bound from below.
//
// First the nodes nearby relax alone, preconditioned by their own blocks D⁻¹: the others held still, too
// little is released. So all nodes relax then, from where the first are, preconditioned by
//
//   Eᵀ C E + D⁻¹ of the nodes nearby
//
// E: sums the sides of a parted node. C spreads what is out of balance over the body as if it were whole, and
// D⁻¹ moves the sides against each other: some ten steps tell.
#include "physics/cutting/opening_energy.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "physics/tissue/surface.h"
#include "physics/tissue/tetrahedron.h"

namespace hapticd {
namespace {

// Nodes nearby, about. With them alone a beam of two arms opens at 1.21, 1.18, 1.17 times theory's load with
// 4, 6, 8 elements over an arm; with all at 1.09, 1.04, 1.02.
constexpr std::size_t room = 600;
constexpr int most_iterations = 200;
constexpr int most_of_all = 30;    // … of the whole body
constexpr double promising = 0.3;  // part of what is asked: worth a look at the whole body
constexpr double settled = 1e-3;   // of what is released: a step that adds less ends
constexpr double hopeless = 100;   // steps like the last ones, that would not reach what is asked

using Nodal = std::vector<Vec3>;

double dot(const Nodal& a, const Nodal& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i].dot(b[i]);
  return sum;
}

constexpr int stays = -1, parted = -2;

// What moves once the faces are open. Unknowns are numbered.
class Opened {
 public:
  Opened(const TissueModel& model, const TissueState& state, CutWorkspace& work, const VecX& pressed)
      : model_(model),
        state_(state),
        work_(work),
        pressed_(pressed),
        of_node_(static_cast<std::size_t>(model.node_count()), stays) {}

  OpeningEnergy with(std::span<const int> faces, double toughness, const ApplyCompliance& compliance) {
    std::vector<int> nodes = hold_open(faces);
    std::erase_if(nodes, [&](int n) { return !part(n); });
    OpeningEnergy energy;
    energy.area = area(nodes);
    for (const int id : held_) work_.held_open[id] = work_.held_open[model_.across[id]] = 0;
    if (energy.area > 0) {
      gather(nodes);
      energy.released = released(toughness * energy.area, compliance);
    }
    return energy;
  }

 private:
  struct Side {
    Vec3 force = Vec3::Zero();
    double mass = 0;
    int unknown = -1;
  };
  // Times its volume.
  struct Element {
    std::array<int, 4> unknown;
    double mu, lambda;
    Gradients b;
  };

  bool moves(int n) const { return !model_.fixed[n]; }
  // The way in which contacts hold the node; zero: none does.
  Vec3 held_along(int n) const {
    return 3 * n + 2 < pressed_.size() ? Vec3(pressed_.segment<3>(3 * n)).stableNormalized()
                                       : Vec3(Vec3::Zero());
  }
  int corner_of(int t, int n) const {
    const Tet& tet = model_.mesh.tets[t];
    return static_cast<int>(std::find(tet.begin(), tet.end(), n) - tet.begin());
  }
  double spring(int n) const { return model_.springs.empty() ? 0 : model_.springs[n].stiffness; }

  // Returns the faces' nodes.
  std::vector<int> hold_open(std::span<const int> faces) {
    std::vector<int> nodes;
    for (const int id : faces) {
      if (!is_inner(model_, state_, id)) continue;
      for (const int n : outward_face(model_.mesh.tets[id / 4], id % 4)) nodes.push_back(n);
      if (work_.held_open[id]) continue;
      work_.held_open[id] = work_.held_open[model_.across[id]] = 1;
      held_.push_back(id);
    }
    std::sort(nodes.begin(), nodes.end());
    nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
    return nodes;
  }

  // The node's sides and which corner is whose, if it parts. The first keeps its spring (opening.h).
  bool part(int n) {
    const int sides = label_star(model_, state_, work_, n);
    const std::size_t first = side_.size();
    Side all;
    for (const int t : work_.star) {
      if (sides < 2) break;
      const std::size_t s = first + static_cast<std::size_t>(work_.label[t]);
      side_.resize(std::max(side_.size(), s + 1));
      const int corner = corner_of(t, n);
      side_at_[4 * t + corner] = static_cast<int>(s);
      const auto& [mu, lambda, density] = model_.elastic[t];
      const double volume = volume_left(model_, state_, t);
      const Mat3 F = deformation_gradient(corners_of(model_.mesh.tets[t], state_.x), model_.gradients[t]);
      const Corners f = element_forces(F, state_.rotation[t], model_.gradients[t], volume, mu, lambda);
      side_[s].force += f.col(corner);
      side_[s].mass += 0.25 * density * volume;
    }
    forget_labels(work_);
    if (sides < 2) return false;
    if (spring(n) > 0) side_[first].force -= spring(n) * (state_.x[n] - model_.springs[n].anchor);
    for (std::size_t s = first; s < side_.size(); ++s) {
      all.force += side_[s].force;
      all.mass += side_[s].mass;
    }
    for (std::size_t s = first; s < side_.size(); ++s) {
      side_[s].force -= side_[s].mass / all.mass * all.force;
      if (moves(n)) side_[s].unknown = new_unknown(n, s == first ? spring(n) : 0);
    }
    of_node_[n] = parted;
    return true;
  }

  int new_unknown(int n, double stiffness) {
    node_.push_back(n);
    held_along_.push_back(held_along(n));
    spring_.push_back(stiffness);
    return static_cast<int>(spring_.size()) - 1;
  }

  // −1: its node is whole.
  int side_of(int t, int n) const {
    const auto found = side_at_.find(4 * t + corner_of(t, n));
    return found == side_at_.end() ? -1 : found->second;
  }

  // Of the faces at nodes that part whose two sides have not all three nodes in common any longer.
  double area(const std::vector<int>& nodes) {
    const auto& X = model_.mesh.nodes;
    std::unordered_set<int> seen;
    double area = 0;
    for (const int n : nodes) {
      work_.stars.live(state_, n, work_.star);
      for (const int t : work_.star)
        for (int id = 4 * t; id < 4 * t + 4; ++id) {
          const int other = model_.across[id];
          if (!work_.held_open[id] || other < id || !is_inner(model_, state_, id)) continue;
          const Triangle f = outward_face(model_.mesh.tets[t], id % 4);
          const bool joined =
              std::all_of(f.begin(), f.end(), [&](int k) { return side_of(t, k) == side_of(other / 4, k); });
          if (!joined && seen.insert(id).second)
            area += 0.5 * (X[f[1]] - X[f[0]]).cross(X[f[2]] - X[f[0]]).norm();
        }
    }
    return area;
  }

  // Whole nodes around, edge by edge, and every tetrahedron that deforms with what moves.
  void gather(const std::vector<int>& nodes) {
    std::vector<std::uint8_t> reached(model_.node_count(), 0), taken(model_.tets_in_use, 0);
    for (const int n : nodes) reached[n] = 1;
    std::vector<int> front = nodes, next;
    for (bool last = false; !front.empty(); std::swap(front, next)) {
      next.clear();
      std::vector<int> tets;
      for (const int n : front) {
        work_.stars.live(state_, n, work_.star);
        for (const int t : work_.star) {
          if (std::exchange(taken[t], 1)) continue;
          tets.push_back(t);
          for (const int k : model_.mesh.tets[t])
            if (!last && !std::exchange(reached[k], 1)) next.push_back(k);
        }
      }
      last = last || spring_.size() + next.size() > room;
      for (const int n : next) number(n);
      around_.insert(around_.end(), tets.begin(), tets.end());
    }
    for (const int t : around_) add_element(t);
  }

  void gather_all() {
    for (int n = 0; n < model_.nodes_in_use; ++n)
      if (of_node_[n] == stays && state_.live_tets_of_node[n] > 0) number(n);
    element_.clear();
    for (int t = 0; t < model_.tets_in_use; ++t)
      if (state_.alive[t]) add_element(t);
  }

  void number(int n) {
    if (moves(n)) of_node_[n] = new_unknown(n, spring(n));
  }

  void add_element(int t) {
    const double volume = volume_left(model_, state_, t);
    Element e{{},
              volume * model_.elastic[t].mu,
              volume * model_.elastic[t].lambda,
              state_.rotation[t] * model_.gradients[t]};
    for (int a = 0; a < 4; ++a) {
      e.unknown[a] = of_node_[model_.mesh.tets[t][a]];
      if (e.unknown[a] == parted) e.unknown[a] = side_[side_at_.at(4 * t + a)].unknown;
    }
    element_.push_back(e);
  }

  // K p: of each tetrahedron V (μ (G + Gᵀ) + λ tr(G) I) b_a with G = Σ_a p_a b_aᵀ.
  void multiply(const Nodal& p, Nodal& Kp) const {
    for (std::size_t u = 0; u < p.size(); ++u) Kp[u] = spring_[u] * p[u];
    for (const Element& e : element_) {
      Mat3 G = Mat3::Zero();
      for (int a = 0; a < 4; ++a)
        if (e.unknown[a] >= 0) G += p[e.unknown[a]] * e.b.col(a).transpose();
      const Mat3 stress = e.mu * (G + G.transpose()) + e.lambda * G.trace() * Mat3::Identity();
      for (int a = 0; a < 4; ++a)
        if (e.unknown[a] >= 0) Kp[e.unknown[a]] += stress * e.b.col(a);
    }
  }

  // Stops as soon as it is known whether `asked` is there.
  double released(double asked, const ApplyCompliance& compliance) {
    Nodal r = unbalanced(), u(r.size(), Vec3::Zero());
    const std::vector<Mat3> D = inverse_of_blocks();
    double energy = 0;
    const auto relax = [&](int iterations, const auto& precondition) {
      const std::size_t size = spring_.size();
      Nodal z(size), p(size), Kp(size);
      hold(r);
      precondition(r, z);
      hold(z);
      p = z;
      double lately = 0, rz = dot(r, z);
      for (int k = 0; k < iterations && rz > 0; ++k) {
        multiply(p, Kp);
        hold(Kp);
        const double stiffness = dot(p, Kp);
        if (!(stiffness > 0)) break;
        const double alpha = rz / stiffness;
        const double gain = 0.5 * alpha * rz;
        energy += gain;
        lately = std::max(0.5 * lately, gain);
        for (std::size_t i = 0; i < size; ++i) u[i] += alpha * p[i];
        if (energy >= asked || lately < settled * energy || hopeless * lately < asked - energy) break;
        for (std::size_t i = 0; i < size; ++i) r[i] -= alpha * Kp[i];
        precondition(r, z);
        hold(z);
        const double before = std::exchange(rz, dot(r, z));
        for (std::size_t i = 0; i < size; ++i) p[i] = z[i] + rz / before * p[i];
      }
    };
    relax(most_iterations, [&](const Nodal& f, Nodal& z) {
      for (std::size_t i = 0; i < f.size(); ++i) z[i] = D[i] * f[i];
    });
    if (!compliance || energy >= asked || energy < promising * asked) return energy;

    const std::size_t near = spring_.size();
    gather_all();
    const std::size_t size = spring_.size();
    Nodal Ku(size);
    u.resize(size, Vec3::Zero());
    r = unbalanced();
    multiply(u, Ku);
    for (std::size_t i = 0; i < size; ++i) r[i] -= Ku[i];
    VecX f(3 * model_.node_count()), dx(f.size());
    relax(most_of_all, [&](const Nodal& g, Nodal& z) {
      f.setZero();
      for (std::size_t i = 0; i < size; ++i) f.segment<3>(3 * node_[i]) += g[i];
      compliance(f, dx);
      for (std::size_t i = 0; i < size; ++i) z[i] = dx.segment<3>(3 * node_[i]);
      for (std::size_t i = 0; i < near; ++i) z[i] += D[i] * g[i];
    });
    return energy;
  }

  // g.
  Nodal unbalanced() const {
    Nodal g(spring_.size(), Vec3::Zero());
    for (const Side& side : side_)
      if (side.unknown >= 0) g[side.unknown] = side.force;
    return g;
  }

  void hold(Nodal& v) const {
    for (std::size_t i = 0; i < v.size(); ++i) v[i] -= held_along_[i].dot(v[i]) * held_along_[i];
  }

  std::vector<Mat3> inverse_of_blocks() const {
    std::vector<Mat3> D(spring_.size());
    for (std::size_t i = 0; i < D.size(); ++i) D[i] = spring_[i] * Mat3::Identity();
    for (const Element& e : element_)
      for (int a = 0; a < 4; ++a)
        if (e.unknown[a] >= 0) D[e.unknown[a]] += stiffness_block(e.b.col(a), e.b.col(a), 1, e.mu, e.lambda);
    for (Mat3& block : D) block = block.inverse().eval();
    return D;
  }

  const TissueModel& model_;
  const TissueState& state_;
  CutWorkspace& work_;
  const VecX& pressed_;
  std::vector<int> held_;  // faces that this opening alone holds open
  std::vector<Side> side_;
  std::unordered_map<int, int> side_at_;  // by 4·tet + corner
  std::vector<int> node_;                 // per unknown
  Nodal held_along_;                      // … a unit vector, or zero
  std::vector<double> spring_;            // … [N/m]
  std::vector<int> of_node_;              // its unknown, `stays` or `parted`
  std::vector<int> around_;               // tetrahedra that deform with the nodes nearby
  std::vector<Element> element_;
};

}  // namespace

OpeningEnergy energy_of_opening(const TissueModel& model, const TissueState& state, CutWorkspace& work,
                                std::span<const int> faces, const VecX& pressed, double toughness,
                                const ApplyCompliance& compliance) {
  return Opened(model, state, work, pressed).with(faces, toughness, compliance);
}

}  // namespace hapticd
