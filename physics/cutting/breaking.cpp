// σ = 2 μ ε + λ tr(ε) I with ε = sym(RᵀF) − I in each tetrahedron's turned frame, where the face's normal is
// that of the rest shape. A face that was told to open and still hangs by its nodes (CutWorkspace::held_open)
// is part of the surface: the crack goes on from its edges.
#include "physics/cutting/breaking.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

#include "physics/cutting/opening_energy.h"
#include "physics/tissue/tetrahedron.h"

namespace hapticd {
namespace {

// c: so large that the energy decides from four elements over a beam's arm on (TearingBeam.*).
constexpr double flaw = 40;
constexpr int fewest_joined = 1;     // faces that a tetrahedron keeps: none comes off alone
constexpr int most_together = 8;     // times TearSettings::most: where no slit is yet, only many faces pay
constexpr int looks_in_a_step = 1;   // at the energy of faces that part something: a few milliseconds
constexpr double most_growth = 1.5;  // of Σ release until all are looked at again

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

struct Candidate {
  double release;
  int face;
};

// Those that tension would break, the largest first.
std::vector<Candidate> stretched_faces(const TissueModel& model, const TissueState& state,
                                       std::span<const std::uint8_t> held_open,
                                       const TearSettings& settings) {
  const auto may_break = [&](int id) {
    return settings.clefts.empty() || (id < std::ssize(settings.clefts) && settings.clefts[id]);
  };
  std::vector<Mat3> stress(model.tets_in_use);
  for (int t = 0; t < model.tets_in_use; ++t)
    if (state.alive[t]) stress[t] = turned_stress(model, state, t);
  std::vector<Candidate> found;
  for (int t = 0; t < model.tets_in_use; ++t) {
    if (!state.alive[t]) continue;
    for (int id = 4 * t; id < 4 * t + 4; ++id) {
      const int other = model.across[id];
      if (other < id || held_open[id] || !may_break(id) || !state.alive[other / 4]) continue;
      const Mat3 mean = 0.5 * (stress[t] + stress[other / 4]);
      const double released = release(mean, area_vector(model, id), model.elastic[t]);
      if (released > settings.toughness) found.push_back({released, id});
    }
  }
  std::sort(found.begin(), found.end(), [](const Candidate& l, const Candidate& r) {
    return l.release != r.release ? l.release > r.release : l.face < r.face;
  });
  return found;
}

// Where a crack may go at once: from the face under the largest tension that is left, at an open edge, on to
// those that are next to it.
class Growth {
 public:
  Growth(const TissueModel& model, const TissueState& state, const std::vector<EdgeKey>& open,
         std::span<const std::uint8_t> held_open, const TearSettings& settings, std::vector<Candidate> found)
      : model_(model), state_(state), held_open_(held_open), settings_(settings), found_(std::move(found)) {
    const int count = static_cast<int>(found_.size());
    taken_.resize(found_.size(), 0);
    for (int i = 0; i < count; ++i) {
      const Triangle n = nodes_of(i);
      bool at_open_edge = false;
      for (int k = 0; k < 3; ++k) {
        at_node_.push_back({n[k], i});
        at_edge_.push_back({edge_key(n[k], n[(k + 1) % 3]), i});
        at_open_edge = at_open_edge || std::binary_search(open.begin(), open.end(), at_edge_.back().first);
      }
      at_open_edge_.push_back(at_open_edge);
    }
    std::sort(at_node_.begin(), at_node_.end());
    std::sort(at_edge_.begin(), at_edge_.end());
  }

  // `most` faces at most, in the order in which they open; empty: none is left.
  std::vector<int> next(int most) {
    std::vector<int> faces;
    std::vector<std::uint8_t> beside(found_.size(), 1), open = at_open_edge_;
    std::map<int, int> parted;  // faces of a tetrahedron that open with these
    while (static_cast<int>(faces.size()) < most) {
      std::size_t i = 0;
      while (i < found_.size() &&
             (taken_[i] || !open[i] || !beside[i] || !stays_joined(found_[i].face, parted)))
        ++i;
      if (i == found_.size()) break;
      if (faces.empty()) std::fill(beside.begin(), beside.end(), std::uint8_t{0});
      const int face = found_[i].face;
      faces.push_back(face);
      taken_[i] = 1;
      ++parted[face / 4];
      ++parted[model_.across[face] / 4];
      const Triangle n = nodes_of(static_cast<int>(i));
      for (int k = 0; k < 3; ++k) {
        mark(at_node_, n[k], beside);
        mark(at_edge_, edge_key(n[k], n[(k + 1) % 3]), open);
      }
    }
    return faces;
  }

 private:
  Triangle nodes_of(int i) const {
    const int face = found_[static_cast<std::size_t>(i)].face;
    return outward_face(model_.mesh.tets[face / 4], face % 4);
  }

  template <class Key>
  static void mark(const std::vector<std::pair<Key, int>>& at, Key key, std::vector<std::uint8_t>& marks) {
    for (auto it = std::lower_bound(at.begin(), at.end(), std::pair(key, -1));
         it != at.end() && it->first == key; ++it)
      marks[static_cast<std::size_t>(it->second)] = 1;
  }

  bool stays_joined(int id, std::map<int, int>& parted) const {
    if (!settings_.clefts.empty()) return true;
    const int t = id / 4, other = model_.across[id] / 4;
    return faces_joined(model_, state_, held_open_, t) - parted[t] > fewest_joined &&
           faces_joined(model_, state_, held_open_, other) - parted[other] > fewest_joined;
  }

  const TissueModel& model_;
  const TissueState& state_;
  const std::span<const std::uint8_t> held_open_;
  const TearSettings& settings_;
  const std::vector<Candidate> found_;
  std::vector<std::uint8_t> taken_, at_open_edge_;  // of each
  std::vector<std::pair<int, int>> at_node_;        // which of them, sorted
  std::vector<std::pair<EdgeKey, int>> at_edge_;    // …
};

}  // namespace

double release_of_face(const TissueModel& model, const TissueState& state, int face) {
  const int other = model.across[face];
  const Mat3 stress = 0.5 * (turned_stress(model, state, face / 4) + turned_stress(model, state, other / 4));
  return release(stress, area_vector(model, face), model.elastic[face / 4]);
}

std::vector<int> faces_that_break(const TissueModel& model, const TissueState& state,
                                  const BoundarySurface& surface, CutWorkspace& work,
                                  const TearSettings& settings, const VecX& pressed, RefusedBreaks* refused,
                                  const ApplyCompliance& compliance) {
  if (!(settings.toughness > 0) || !settings.begins) return {};
  std::vector<Candidate> found = stretched_faces(model, state, work.held_open, settings);
  double sum = 0;
  for (const Candidate& c : found) sum += c.release;
  if (found.empty() || (refused && sum < refused->until)) return {};
  Growth growth(model, state, open_edges(model, surface, work.held_open), work.held_open, settings,
                std::move(found));
  const RefusedBreaks before = refused ? *refused : RefusedBreaks{};
  double paid = before.paid;
  for (int place = 0, looks = 0;; ++place) {
    std::vector<int> faces = growth.next(most_together * settings.most);
    if (faces.empty()) break;
    if (place < before.places) continue;
    int halved = place == before.places ? before.halved : 0;
    for (std::size_t n = faces.size() >> halved; n > 0; n /= 2, ++halved) {
      faces.resize(n);
      if (refused && looks == looks_in_a_step) {
        *refused = {.until = 0, .places = place, .halved = halved, .paid = paid};
        return {};
      }
      const OpeningEnergy e =
          energy_of_opening(model, state, work, faces, pressed, settings.toughness, compliance);
      const double needed = settings.toughness * e.area;
      const auto most = static_cast<std::size_t>(settings.most);
      if (e.area > 0 ? e.released >= needed : n >= most) {
        if (refused) *refused = {};
        if (e.area == 0 || settings.clefts.empty()) faces.resize(std::min(n, most));
        return faces;
      }
      if (!(e.area > 0)) break;  // nor do fewer part anything
      ++looks;
      paid = std::max(paid, e.released / needed);
    }
  }
  if (refused) *refused = {.until = sum * std::min(most_growth, 1 / std::sqrt(paid))};
  return {};
}

}  // namespace hapticd
