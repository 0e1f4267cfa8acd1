#include "physics/cutting/blade_cut.h"

#include <algorithm>
#include <cmath>

#include "physics/cutting/opening.h"
#include "physics/cutting/subdivision.h"

namespace hapticd {
namespace {

constexpr double least_along = 0.3;  // of a face's normal along the strip's

}  // namespace

BladeCut::BladeCut(const TissueModel& model, const CutLimits& limits)
    : limits_(limits), grid_(model), on_(model.mesh.nodes.size(), 0), side_(model.mesh.tets.size(), 0) {
  const std::size_t tets = model.mesh.tets.size();
  for (std::vector<int>* v : {&on_nodes_, &new_on_}) v->reserve(model.mesh.nodes.size());
  for (std::vector<int>* v : {&near_, &cluster_, &star_, &sided_}) v->reserve(tets);
  faces_.reserve(4 * tets);
  edges_.reserve(6 * tets);
  crossed_.reserve(6 * tets);
}

void BladeCut::start() noexcept {
  for (const int n : on_nodes_) on_[n] = 0;
  for (const int t : sided_) side_[t] = 0;
  on_nodes_.clear();
  sided_.clear();
}

CutStatus BladeCut::extend(TissueModel& model, TissueState& state, CutWorkspace& work,
                           const SweptSurface& strip, TopologyChange& change) noexcept {
  if (strip.empty()) return CutStatus::nothing;
  new_on_.clear();
  find_crossed(model, state, strip);
  if (crossed_.empty()) return CutStatus::nothing;
  snap_ends();
  if (split_edges(model, state, work, change) == CutStatus::no_room) return CutStatus::no_room;
  find_faces(model, state, work, strip);
  if (faces_.empty()) return CutStatus::done;
  const std::size_t first_twin = change.nodes.size();
  if (open_faces(model, state, work, faces_, change) == CutStatus::no_room) return CutStatus::no_room;
  for (std::size_t k = first_twin; k < change.nodes.size(); ++k) put_on(change.nodes[k]);
  return CutStatus::done;
}

void BladeCut::put_on(int node) noexcept {
  if (on_[node]) return;
  on_[node] = 1;
  on_nodes_.push_back(node);
  new_on_.push_back(node);
}

// Edges with an end on the surface are not crossed by it.
void BladeCut::find_crossed(const TissueModel& model, const TissueState& state,
                            const SweptSurface& strip) noexcept {
  Eigen::AlignedBox3d box = strip.box();
  const Vec3 margin = Vec3::Constant(1e-6 * grid_.mean_edge());
  box = {box.min() - margin, box.max() + margin};
  grid_.find(model, state, box, near_);
  edges_.clear();
  for (const int t : near_)
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < i; ++j) {
        const Edge edge = std::minmax(model.mesh.tets[t][i], model.mesh.tets[t][j]);
        if (!on_[edge.first] && !on_[edge.second]) edges_.push_back(edge);
      }
  std::sort(edges_.begin(), edges_.end());
  edges_.erase(std::unique(edges_.begin(), edges_.end()), edges_.end());
  crossed_.clear();
  for (const auto& [a, b] : edges_) {
    const Vec3& from = model.mesh.nodes[a];
    const Vec3& to = model.mesh.nodes[b];
    if (const auto s = strip.crossing(from, to)) crossed_.push_back({a, b, *s, (to - from).norm()});
  }
}

void BladeCut::snap_ends() noexcept {
  for (const Crossed& c : crossed_)
    if (c.s < limits_.snap || c.s > 1 - limits_.snap) put_on(c.s < 0.5 ? c.a : c.b);
}

CutStatus BladeCut::split_edges(TissueModel& model, TissueState& state, CutWorkspace& work,
                                TopologyChange& change) noexcept {
  for (const Crossed& c : crossed_) {
    if (on_[c.a] || on_[c.b]) continue;
    const bool is_short = c.length < limits_.least_edge * grid_.mean_edge();
    const CutStatus status =
        is_short ? CutStatus::poor : split_edge(model, state, work, {c.a, c.b, c.s}, limits_.quality, change);
    if (status == CutStatus::no_room) return status;
    put_on(status == CutStatus::done ? model.nodes_in_use - 1 : c.s < 0.5 ? c.a : c.b);
  }
  return CutStatus::done;
}

bool BladeCut::all_on(const TissueModel& model, int tet) const noexcept {
  const Tet& nodes = model.mesh.tets[tet];
  return std::all_of(nodes.begin(), nodes.end(), [&](int n) { return on_[n] != 0; });
}

// The faces that became part of the surface, between elements of different sides.
void BladeCut::find_faces(const TissueModel& model, const TissueState& state, CutWorkspace& work,
                          const SweptSurface& strip) noexcept {
  faces_.clear();
  for (const int n : new_on_) {
    work.stars.live(state, n, star_);
    for (const int t : star_)
      for (int f = 0; f < 4; ++f) {
        const int id = 4 * t + f;
        const int other = model.across[id];
        const Triangle face = outward_face(model.mesh.tets[t], f);
        if (other < id || !state.alive[other / 4] ||
            !std::all_of(face.begin(), face.end(), [&](int m) { return on_[m] != 0; }))
          continue;
        if (side_of(model, state, t, strip) != side_of(model, state, other / 4, strip)) faces_.push_back(id);
      }
  }
}

// Of an element with a face on the surface: the side of its fourth node, as that face sees it, for the cut
// runs along the face and not along the strip. A face that stands across the strip does not tell.
int BladeCut::side_of(const TissueModel& model, const TissueState& state, int tet,
                      const SweptSurface& strip) noexcept {
  if (side_[tet] != 0) return side_[tet];
  if (all_on(model, tet)) return side_of_cluster(model, state, tet, strip);
  const Tet& nodes = model.mesh.tets[tet];
  const auto& X = model.mesh.nodes;
  const auto apex = std::find_if(nodes.begin(), nodes.end(), [&](int n) { return !on_[n]; });
  const Triangle face = outward_face(nodes, static_cast<int>(apex - nodes.begin()));
  const Vec3 outward = (X[face[1]] - X[face[0]]).cross(X[face[2]] - X[face[0]]).normalized();
  const double along = outward.dot(strip.normal((X[face[0]] + X[face[1]] + X[face[2]]) / 3));
  const double side = std::abs(along) > least_along ? -along : strip.side(X[*apex]);
  side_[tet] = side > 0 ? 1 : -1;
  sided_.push_back(tet);
  return side_[tet];
}

// Elements with all nodes on the surface that faces join have one side.
int BladeCut::side_of_cluster(const TissueModel& model, const TissueState& state, int tet,
                              const SweptSurface& strip) noexcept {
  cluster_.assign(1, tet);
  side_[tet] = -1;
  int side = -1;
  for (std::size_t k = 0; k < cluster_.size(); ++k)
    for (int id = 4 * cluster_[k]; id < 4 * cluster_[k] + 4; ++id) {
      const int neighbour = model.across[id] / 4;
      if (model.across[id] < 0 || !state.alive[neighbour]) continue;
      if (side_[neighbour] == 0 && all_on(model, neighbour)) {
        side_[neighbour] = -1;
        cluster_.push_back(neighbour);
      } else {
        side = std::max(side, side_of(model, state, neighbour, strip));
      }
    }
  for (const int t : cluster_) {
    side_[t] = static_cast<std::int8_t>(side);
    sided_.push_back(t);
  }
  return side;
}

}  // namespace hapticd
