// σ = 2 μ ε + λ tr(ε) I with ε = sym(RᵀF) − I in each tetrahedron's turned frame, where the face's normal is
// that of the rest shape. A face that was told to open and still hangs by its nodes (CutWorkspace::held_open)
// is part of the surface: the crack goes on from its edges.
#include "physics/cutting/breaking.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

#include "physics/tissue/tetrahedron.h"

namespace hapticd {
namespace {

// c: with it a beam of two arms breaks at 1.06 times beam theory's load with eight elements over an arm
// (TearingBeam.*), 1.65 with four.
constexpr double flaw = 10;
constexpr int fewest_joined = 1;  // faces that a tetrahedron keeps: none comes off alone

using EdgeKey = std::uint64_t;
EdgeKey edge_key(int a, int b) noexcept {
  return static_cast<EdgeKey>(std::min(a, b)) << 32 | static_cast<EdgeKey>(std::max(a, b));
}

Mat3 turned_stress(const TissueModel& model, const TissueState& state, int t) {
  const auto& [mu, lambda, density] = model.elastic[t];
  const Mat3 F = deformation_gradient(corners_of(model.mesh.tets[t], state.x), model.gradients[t]);
  const Mat3 S = state.rotation[t].transpose() * F;
  const Mat3 strain = 0.5 * (S + S.transpose()) - Mat3::Identity();
  return 2 * mu * strain + lambda * strain.trace() * Mat3::Identity();
}

double plane_modulus(const Elasticity& e) { return 4 * e.mu * (e.lambda + e.mu) / (e.lambda + 2 * e.mu); }

// c l σₙ²/E' of the face of tetrahedron t, area vector A (outward), under that stress.
double release(const Mat3& stress, const Vec3& A, const Elasticity& e) {
  const double area = A.norm();
  const double tension = A.dot(stress * A) / (area * area);
  return tension > 0 ? flaw * std::sqrt(area) * tension * tension / plane_modulus(e) : 0;
}

Vec3 area_vector(const TissueModel& model, int face) {
  const auto& X = model.mesh.nodes;
  const Triangle n = outward_face(model.mesh.tets[face / 4], face % 4);
  return 0.5 * (X[n[1]] - X[n[0]]).cross(X[n[2]] - X[n[0]]);
}

// Sorted: edges of the surface, and of faces that are open but for their nodes.
std::vector<EdgeKey> open_edges(const TissueModel& model, const BoundarySurface& surface,
                                std::span<const std::uint8_t> held_open) {
  std::vector<EdgeKey> edges;
  const auto add = [&](const Triangle& n) {
    for (int k = 0; k < 3; ++k) edges.push_back(edge_key(n[k], n[(k + 1) % 3]));
  };
  for (const SurfaceFace& f : surface.faces()) add(f.nodes);
  for (int id = 0; id < 4 * model.tets_in_use; ++id)
    if (held_open[id]) add(outward_face(model.mesh.tets[id / 4], id % 4));
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

int faces_joined(const TissueModel& model, const TissueState& state, std::span<const std::uint8_t> held_open,
                 int t) {
  int joined = 0;
  for (int id = 4 * t; id < 4 * t + 4; ++id)
    joined += !held_open[id] && model.across[id] >= 0 && state.alive[model.across[id] / 4];
  return joined;
}

}  // namespace

double release_of_face(const TissueModel& model, const TissueState& state, int face) {
  const int other = model.across[face];
  const Mat3 stress = 0.5 * (turned_stress(model, state, face / 4) + turned_stress(model, state, other / 4));
  return release(stress, area_vector(model, face), model.elastic[face / 4]);
}

std::vector<int> faces_that_break(const TissueModel& model, const TissueState& state,
                                  const BoundarySurface& surface, std::span<const std::uint8_t> held_open,
                                  const TearSettings& settings) {
  std::vector<int> faces;
  if (!(settings.toughness > 0) || !settings.begins) return faces;

  const auto may_break = [&](int id) {
    return settings.clefts.empty() || (id < std::ssize(settings.clefts) && settings.clefts[id]);
  };
  std::vector<Mat3> stress(model.tets_in_use);
  for (int t = 0; t < model.tets_in_use; ++t)
    if (state.alive[t]) stress[t] = turned_stress(model, state, t);
  std::vector<std::pair<double, int>> found;
  for (int t = 0; t < model.tets_in_use; ++t) {
    if (!state.alive[t]) continue;
    for (int id = 4 * t; id < 4 * t + 4; ++id) {
      const int other = model.across[id];
      if (other < id || held_open[id] || !may_break(id) || !state.alive[other / 4]) continue;
      const Mat3 mean = 0.5 * (stress[t] + stress[other / 4]);
      const double released = release(mean, area_vector(model, id), model.elastic[t]);
      if (released > settings.toughness) found.emplace_back(released, id);
    }
  }
  if (found.empty()) return faces;
  const std::vector<EdgeKey> edges = open_edges(model, surface, held_open);
  std::sort(found.begin(), found.end(), [](const auto& l, const auto& r) {
    return l.first != r.first ? l.first > r.first : l.second < r.second;
  });
  std::map<int, int> taken;  // faces of a tetrahedron that open in this step
  for (const auto& [released, id] : found) {
    if (static_cast<int>(faces.size()) >= settings.most) break;
    const Triangle n = outward_face(model.mesh.tets[id / 4], id % 4);
    const auto is_open = [&](int k) {
      return std::binary_search(edges.begin(), edges.end(), edge_key(n[k], n[(k + 1) % 3]));
    };
    if (!is_open(0) && !is_open(1) && !is_open(2)) continue;
    if (settings.clefts.empty()) {
      const int t = id / 4, other = model.across[id] / 4;
      if (faces_joined(model, state, held_open, t) - taken[t] <= fewest_joined ||
          faces_joined(model, state, held_open, other) - taken[other] <= fewest_joined)
        continue;
      ++taken[t];
      ++taken[other];
    }
    faces.push_back(id);
  }
  return faces;
}

}  // namespace hapticd
