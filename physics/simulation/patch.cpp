#include "physics/simulation/patch.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "physics/simulation/sample_id.h"

namespace hapticd {
namespace {

constexpr int max_subdivisions = 16;

std::vector<std::array<double, 3>> make_weights(int k) {
  std::vector<std::array<double, 3>> out;
  const double h = 1.0 / k;
  for (int i = 0; i < k; ++i)
    for (int j = 0; i + j < k; ++j) {
      const double u = (i + 1.0 / 3) * h, v = (j + 1.0 / 3) * h;
      out.push_back({1 - u - v, u, v});
      if (i + j + 1 < k) {
        const double s = (i + 2.0 / 3) * h, t = (j + 2.0 / 3) * h;
        out.push_back({1 - s - t, s, t});
      }
    }
  return out;
}

double nearest_gap(Instruments instruments, const InstrumentPoses& X, const Vec3& x) {
  double nearest = std::numeric_limits<double>::infinity();
  for (int i = 0; i < instruments.count(); ++i)
    if (X.present[i]) nearest = std::min(nearest, gap_at(instruments[i], X[i], x).distance);
  return nearest;
}

Vec3 weighted(const std::array<double, 3>& w, const Vec3& a, const Vec3& b, const Vec3& c) {
  return w[0] * a + w[1] * b + w[2] * c;
}

}  // namespace

int subdivisions(const Vec3& a, const Vec3& b, const Vec3& c, double spacing) {
  const double area = 0.5 * (b - a).cross(c - a).norm();
  return std::clamp(static_cast<int>(std::ceil(std::sqrt(area) / spacing)), 1, max_subdivisions);
}

const std::vector<std::array<double, 3>>& sample_weights(int k) {
  static const auto tables = [] {
    std::array<std::vector<std::array<double, 3>>, max_subdivisions + 1> t;
    for (int i = 1; i <= max_subdivisions; ++i) t[i] = make_weights(i);
    return t;
  }();
  return tables[k];
}

// Of the faces that are nearest to an instrument.
int PatchGatherer::deformable_nodes(const Bodies& bodies, int instrument) {
  int count = 0;
  for (const Candidate& c : candidates_) {
    if (c.instrument != instrument) continue;
    const Body& body = bodies[c.face.body];
    for (const int n : body.surface.faces()[c.face.face].nodes)
      if (body.deformable && patch_index_[c.face.body][n] < 0) patch_index_[c.face.body][n] = count++;
  }
  for (const Candidate& c : candidates_)
    for (const int n : bodies[c.face.body].surface.faces()[c.face.face].nodes)
      patch_index_[c.face.body][n] = -1;
  return count;
}

double PatchGatherer::nearest_on_the_way(const Body& body, int face, const Instrument& instrument,
                                         const Pose& X) const {
  constexpr int parts = 4;
  const Triangle& t = body.surface.faces()[face].nodes;
  double nearest = std::numeric_limits<double>::max();
  for (int p = 0; p <= parts; ++p) {
    std::array<Vec3, 3> x;
    for (int c = 0; c < 3; ++c) {
      x[c] = body.state.x[t[c]];
      if (body.deformable) x[c] += static_cast<double>(p) / parts * body.free.dx.segment<3>(3 * t[c]);
    }
    for (const auto& w :
         sample_weights(subdivisions(body.rest()[t[0]], body.rest()[t[1]], body.rest()[t[2]], spacing_)))
      nearest = std::min(nearest, gap_at(instrument, X, weighted(w, x[0], x[1], x[2])).distance);
    if (!body.deformable) break;
  }
  return nearest;
}

void PatchGatherer::gather(const Bodies& bodies, Instruments instruments, const InstrumentPoses& X,
                           double alarm, std::span<const NearFace> near, CondensedProblem& problem,
                           std::span<const PatchNode> first) {
  patch_index_.resize(bodies.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) patch_index_[b].assign(bodies[b].state.x.size(), -1);
  nodes_.clear();
  candidates_.clear();

  for (const NearFace& n : near) {
    const Body& body = bodies[n.body];
    const Triangle& t = body.surface.faces()[n.face].nodes;
    Candidate found{alarm, -1, n};
    for (const auto& w :
         sample_weights(subdivisions(body.rest()[t[0]], body.rest()[t[1]], body.rest()[t[2]], spacing_))) {
      const Vec3 x = weighted(w, body.state.x[t[0]], body.state.x[t[1]], body.state.x[t[2]]);
      for (int i = 0; i < instruments.count(); ++i) {
        if (!X.present[i]) continue;
        if (const double gap = gap_at(instruments[i], X[i], x).distance; gap < found.gap) {
          found.gap = gap;
          found.instrument = i;
        }
      }
    }
    if (found.instrument >= 0) candidates_.push_back(found);
  }
  // Each instrument fills its own share, so that what one lies on leaves the other its tissue.
  int present = 0;
  for (int i = 0; i < instruments.count(); ++i) present += X.present[i];
  const int share = std::min(max_nodes_of_instrument, max_patch_nodes / std::max(present, 1));
  EachInstrument<int> nodes_left;
  for (int i = 0; i < instruments.count(); ++i) {
    nodes_left[i] = share;
    if (deformable_nodes(bodies, i) > share)
      for (Candidate& c : candidates_)
        if (c.instrument == i)
          c.gap = nearest_on_the_way(bodies[c.face.body], c.face.face, instruments[i], X[i]);
  }
  std::sort(candidates_.begin(), candidates_.end(), [](const Candidate& a, const Candidate& b) {
    return a.gap != b.gap ? a.gap < b.gap
                          : std::pair(a.face.body, a.face.face) < std::pair(b.face.body, b.face.face);
  });

  const int room_for_first = present > 0 ? share : 0;
  for (const PatchNode& n : first) {
    int& index = patch_index_[n.body][n.node];
    if (index >= 0 || static_cast<int>(nodes_.size()) >= room_for_first) continue;
    index = static_cast<int>(nodes_.size());
    nodes_.push_back(n);
  }
  for (int i = 0; i < instruments.count(); ++i) nodes_left[i] -= static_cast<int>(nodes_.size());

  problem.samples = 0;
  problem.dropped_samples = 0;
  for (const Candidate& candidate : candidates_) {
    const int b = candidate.face.body;
    const Body& body = bodies[b];
    const SurfaceFace& face = body.surface.faces()[candidate.face.face];
    const Triangle& t = face.nodes;
    const auto& weights =
        sample_weights(subdivisions(body.rest()[t[0]], body.rest()[t[1]], body.rest()[t[2]], spacing_));
    const auto missing =
        body.deformable ? std::count_if(t.begin(), t.end(), [&](int n) { return patch_index_[b][n] < 0; })
                        : 0;
    if (static_cast<int>(missing) > nodes_left[candidate.instrument] ||
        problem.samples + static_cast<int>(weights.size()) > max_patch_samples) {
      problem.dropped_samples += static_cast<int>(weights.size());
      continue;
    }
    nodes_left[candidate.instrument] -= static_cast<int>(missing);
    std::array<std::int32_t, 3> node = {-1, -1, -1};
    if (body.deformable)
      for (int c = 0; c < 3; ++c) {
        int& index = patch_index_[b][t[c]];
        if (index < 0) {
          index = static_cast<int>(nodes_.size());
          nodes_.push_back({b, t[c]});
        }
        node[c] = index;
      }
    const Vec3 normal = (body.state.x[t[1]] - body.state.x[t[0]])
                            .cross(body.state.x[t[2]] - body.state.x[t[0]])
                            .stableNormalized();
    for (std::size_t k = 0; k < weights.size(); ++k) {
      const Vec3 x = weighted(weights[k], body.state.x[t[0]], body.state.x[t[1]], body.state.x[t[2]]);
      if (!(nearest_gap(instruments, X, x) < alarm)) continue;
      PatchSample& s = problem.sample[problem.samples++];
      s.id = sample_id(b, face.id, static_cast<int>(k));
      s.node = node;
      s.weight = weights[k];
      s.free = x;
      s.outward = normal;
      s.friction = body.friction;
    }
  }
  problem.nodes = static_cast<int>(nodes_.size());
  std::sort(problem.sample.begin(), problem.sample.begin() + problem.samples,
            [](const PatchSample& a, const PatchSample& b) { return a.id < b.id; });
}

std::vector<int> PatchGatherer::nodes_of(int body) const {
  std::vector<int> nodes;
  for (const PatchNode& n : nodes_)
    if (n.body == body) nodes.push_back(n.node);
  return nodes;
}

VecX force_on_body(const Body& body, int index, std::span<const PatchNode> nodes, const VecX& patch_force) {
  VecX f = VecX::Zero(3 * body.model.node_count());
  for (std::size_t i = 0; i < nodes.size(); ++i)
    if (nodes[i].body == index)
      f.segment<3>(3 * nodes[i].node) += patch_force.segment<3>(3 * static_cast<Eigen::Index>(i));
  return f;
}

void set_patch_positions(const Bodies& bodies, std::span<const PatchNode> nodes, CondensedProblem& problem) {
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const Body& body = bodies[nodes[i].body];
    problem.x_now[i] = body.state.x[nodes[i].node];
    problem.x_free[i] = problem.x_now[i] + body.free.dx.segment<3>(3 * nodes[i].node);
  }
  for (int k = 0; k < problem.samples; ++k) {
    PatchSample& s = problem.sample[k];
    if (s.node[0] < 0) continue;
    const Vec3 &a = problem.x_now[s.node[0]], &b = problem.x_now[s.node[1]], &c = problem.x_now[s.node[2]];
    s.outward = (b - a).cross(c - a).stableNormalized();
  }
}

}  // namespace hapticd
