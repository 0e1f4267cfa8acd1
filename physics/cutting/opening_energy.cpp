// The forces of all sides of a node together move it as they did while it was whole: tissue is taken to be in
// balance with its inertia, its damping and what loads it. Once it is parted, side c is out of balance by
// g_c, with which the others held it; Σ_c g_c = 0. Conjugate gradients add ½ α rᵀz ≥ 0 to what is released
// with every step, so wherever they stop, −Π(u) is a bound from below.
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

// Nodes that may move, about. With them a beam of two arms opens at 1.22, 1.18, 1.17 times theory's load with
// 4, 6, 8 elements over an arm; with all of them at 1.19 and 1.12 with 4 and 6, fifty milliseconds an
// opening.
constexpr std::size_t room = 600;
constexpr int most_iterations = 200;
constexpr double settled = 1e-3;  // of what is released: a step that adds less ends
constexpr double hopeless = 30;   // steps like the last ones, that would not reach what is asked

using Nodal = std::vector<Vec3>;

double dot(const Nodal& a, const Nodal& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i].dot(b[i]);
  return sum;
}

// What moves once the faces are open. Unknowns are numbered; −1: it stays.
class Opened {
 public:
  Opened(const TissueModel& model, const TissueState& state, CutWorkspace& work, const VecX& pressed)
      : model_(model), state_(state), work_(work), pressed_(pressed) {}

  OpeningEnergy with(std::span<const int> faces, double toughness) {
    std::vector<int> nodes = hold(faces);
    std::erase_if(nodes, [&](int n) { return !part(n); });
    OpeningEnergy energy;
    energy.area = area(nodes);
    for (const int id : held_) work_.held_open[id] = work_.held_open[model_.across[id]] = 0;
    if (energy.area > 0) {
      gather(nodes);
      energy.released = released(toughness * energy.area);
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

  bool moves(int n) const {
    return !model_.fixed[n] && (3 * n + 2 >= pressed_.size() || pressed_.segment<3>(3 * n).isZero(0));
  }
  int corner_of(int t, int n) const {
    const Tet& tet = model_.mesh.tets[t];
    return static_cast<int>(std::find(tet.begin(), tet.end(), n) - tet.begin());
  }
  double spring(int n) const { return model_.springs.empty() ? 0 : model_.springs[n].stiffness; }

  // Returns the faces' nodes.
  std::vector<int> hold(std::span<const int> faces) {
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
      if (moves(n)) side_[s].unknown = new_unknown(s == first ? spring(n) : 0);
    }
    return true;
  }

  int new_unknown(double stiffness) {
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
    std::unordered_set<int> reached(nodes.begin(), nodes.end()), taken;
    std::unordered_map<int, int> of_node;
    std::vector<int> tets, front = nodes, next;
    for (bool last = false; !front.empty(); std::swap(front, next)) {
      next.clear();
      for (const int n : front) {
        work_.stars.live(state_, n, work_.star);
        for (const int t : work_.star) {
          if (!taken.insert(t).second) continue;
          tets.push_back(t);
          for (const int k : model_.mesh.tets[t])
            if (!last && reached.insert(k).second) next.push_back(k);
        }
      }
      last = last || spring_.size() + next.size() > room;
      for (const int n : next)
        if (moves(n)) of_node[n] = new_unknown(spring(n));
    }
    for (const int t : tets) {
      const double volume = volume_left(model_, state_, t);
      Element e{{},
                volume * model_.elastic[t].mu,
                volume * model_.elastic[t].lambda,
                state_.rotation[t] * model_.gradients[t]};
      for (int a = 0; a < 4; ++a) {
        const auto side = side_at_.find(4 * t + a);
        const auto node = of_node.find(model_.mesh.tets[t][a]);
        e.unknown[a] = side != side_at_.end()  ? side_[static_cast<std::size_t>(side->second)].unknown
                       : node != of_node.end() ? node->second
                                               : -1;
      }
      element_.push_back(e);
    }
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

  // Conjugate gradients, preconditioned by the nodes' own blocks.
  double released(double asked) const {
    const std::size_t size = spring_.size();
    std::vector<Mat3> inverse(size);
    for (std::size_t u = 0; u < size; ++u) inverse[u] = spring_[u] * Mat3::Identity();
    for (const Element& e : element_)
      for (int a = 0; a < 4; ++a)
        if (e.unknown[a] >= 0)
          inverse[e.unknown[a]] += stiffness_block(e.b.col(a), e.b.col(a), 1, e.mu, e.lambda);
    for (Mat3& D : inverse) D = D.inverse().eval();
    Nodal r(size, Vec3::Zero()), z(size), p(size), Kp(size);
    for (const Side& s : side_)
      if (s.unknown >= 0) r[s.unknown] = s.force;
    for (std::size_t u = 0; u < size; ++u) p[u] = z[u] = inverse[u] * r[u];
    double released = 0, lately = 0, rz = dot(r, z);
    for (int k = 0; k < most_iterations && rz > 0; ++k) {
      multiply(p, Kp);
      const double alpha = rz / dot(p, Kp);
      const double gain = 0.5 * alpha * rz;
      released += gain;
      lately = std::max(0.5 * lately, gain);
      if (released >= asked || lately < settled * released || hopeless * lately < asked - released) break;
      for (std::size_t u = 0; u < size; ++u) {
        r[u] -= alpha * Kp[u];
        z[u] = inverse[u] * r[u];
      }
      const double before = std::exchange(rz, dot(r, z));
      for (std::size_t u = 0; u < size; ++u) p[u] = z[u] + rz / before * p[u];
    }
    return released;
  }

  const TissueModel& model_;
  const TissueState& state_;
  CutWorkspace& work_;
  const VecX& pressed_;
  std::vector<int> held_;  // faces that this opening alone holds open
  std::vector<Side> side_;
  std::unordered_map<int, int> side_at_;  // by 4·tet + corner
  std::vector<double> spring_;            // per unknown [N/m]
  std::vector<Element> element_;
};

}  // namespace

OpeningEnergy energy_of_opening(const TissueModel& model, const TissueState& state, CutWorkspace& work,
                                std::span<const int> faces, const VecX& pressed, double toughness) {
  return Opened(model, state, work, pressed).with(faces, toughness);
}

}  // namespace hapticd
