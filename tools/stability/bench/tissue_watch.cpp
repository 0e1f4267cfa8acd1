#include "tools/stability/bench/tissue_watch.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "physics/tissue/fragments.h"
#include "physics/tissue/rotation.h"
#include "physics/tissue/tetrahedron.h"

namespace hapticd {
namespace {

// With the rotation at x; the state's may be of where the body was foreseen.
double stored(const Body& body, const std::vector<Vec3>& x, int t) {
  const TissueModel& m = body.model;
  const Mat3 F = deformation_gradient(corners_of(m.mesh.tets[t], x), m.gradients[t]);
  return element_energy(F, nearest_rotation(F, body.state.rotation[t]), volume_left(m, body.state, t),
                        m.elastic[t].mu, m.elastic[t].lambda);
}

bool comes_apart(const Body& body) { return body.deformable && (body.removable || body.toughness > 0); }

}  // namespace

TissueWatch::TissueWatch(const Scene& scene, const Bodies& bodies, double instrument_speed)
    : watched_(bodies.size()) {
  if (!scene.gravity.isZero(0)) throw std::invalid_argument("the watch of free pieces knows no gravity");
  const auto removable = std::find_if(bodies.begin(), bodies.end(), comes_apart);
  if (removable == bodies.end()) throw std::invalid_argument("no body of the scene can be cut");
  for (const Vec3& x : removable->rest()) middle_ += x / static_cast<double>(removable->rest().size());
  double least_damping = std::numeric_limits<double>::infinity(), radius = 0;
  for (const Body& b : bodies) {
    if (!b.deformable) continue;
    for (const Vec3& x : b.rest()) radius = std::max(radius, (x - middle_).norm());
    if (comes_apart(b)) least_damping = std::min(least_damping, b.model.material.rayleigh_mass);
  }
  bounds_.farthest = radius + 2 * instrument_speed / least_damping + 2 * scene.alarm_distance;
  Vec3 low = removable->rest().front(), high = low;
  for (const Vec3& x : removable->rest()) {
    low = low.cwiseMin(x);
    high = high.cwiseMax(x);
  }
  bounds_.fastest = 2 * instrument_speed + (high - low).maxCoeff() * scene.rate;
}

TissueExtremes TissueWatch::look(const Bodies& bodies) {
  TissueExtremes out;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const Body& body = bodies[b];
    if (!body.deformable) continue;
    for (std::size_t n = 0; n < body.state.x.size(); ++n) {
      if (body.state.live_tets_of_node[n] == 0) continue;
      const Vec3 &x = body.state.x[n], &v = body.state.v[n];
      out.finite = out.finite && x.allFinite() && v.allFinite();
      out.farthest = std::max(out.farthest, (x - middle_).norm());
      out.fastest = std::max(out.fastest, v.norm());
    }
    if (!out.finite || !comes_apart(body)) continue;
    look_at_step(body, watched_[b], out);
    look_at_free(body, watched_[b], out);
  }
  out.split = split_;
  split_ = 0;
  return out;
}

// A cut keeps energy, whatever pieces it makes: of the whole body before and after. New nodes have no place
// before it.
void TissueWatch::begin_step(const Bodies& bodies) {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const Body& body = bodies[b];
    if (!comes_apart(body)) continue;
    Watched& w = watched_[b];
    double before = 0;
    for (const Watched::Piece& p : w.piece) before += p.energy;
    const bool split = !w.x.empty() && w.topology != body.topology && w.removed == body.state.removed;
    label_anew(body, w);
    w.x = body.state.x;
    w.v = body.state.v;
    w.before = energies(body, w.pieces, w.x, w.v);
    if (split) split_ = std::max(split_, w.before.sum() - before);
  }
}

void TissueWatch::label_anew(const Body& body, Watched& watched) {
  if (watched.removed != body.state.removed || watched.topology != body.topology) label(body, watched);
}

void TissueWatch::label(const Body& body, Watched& watched) {
  const std::vector<Watched::Piece> before = std::move(watched.piece);
  const std::vector<int> of_tet_before = std::move(watched.pieces.of_tet);
  watched.removed = body.state.removed;
  watched.topology = body.topology;
  watched.pieces = find_pieces(body.model, body.state);
  watched.piece.assign(static_cast<std::size_t>(watched.pieces.count()), {});
  for (int t = 0; t < body.model.tet_count(); ++t) {
    if (watched.pieces.of_tet[t] < 0) continue;
    Watched::Piece& p = watched.piece[watched.pieces.of_tet[t]];
    if (p.tets++ == 0) p.first = t;
  }
  for (Watched::Piece& p : watched.piece) {
    const int was = of_tet_before.empty() ? -1 : of_tet_before[p.first];
    if (was >= 0 && before[was].first == p.first && before[was].tets == p.tets) p.since = before[was].since;
  }
}

VecX TissueWatch::energies(const Body& body, const Pieces& pieces, const std::vector<Vec3>& x,
                           const std::vector<Vec3>& v) {
  VecX H = VecX::Zero(pieces.count());
  for (int t = 0; t < body.model.tet_count(); ++t)
    if (const int p = pieces.of_tet[t]; p >= 0 && body.state.alive[t]) H[p] += stored(body, x, t);
  for (std::size_t n = 0; n < pieces.of_node.size(); ++n)
    if (const int p = pieces.of_node[n]; p >= 0) {
      H[p] += 0.5 * body.state.mass[n] * v[n].squaredNorm();
      if (n < body.model.springs.size()) H[p] += spring_energy(body.model.springs[n], x[n]);
    }
  if (!body.model.condensed) return H;
  TissueState at;
  at.x = x;
  const VecX of_boundary = body.model.condensed->energies(at, nullptr);
  for (Eigen::Index i = 0; i < of_boundary.size(); ++i)
    if (const int p = pieces.of_node[body.model.condensed->node[i]]; p >= 0) H[p] += of_boundary[i];
  return H;
}

void TissueWatch::look_at_step(const Body& body, Watched& watched, TissueExtremes& out) {
  // Pieces as they moved: what goes at a step's end was among them.
  if (!watched.x.empty()) {
    const Pieces& pieces = watched.pieces;
    const VecX H = energies(body, pieces, body.state.x, body.state.v);
    VecX allowed = watched.before;
    const VecX& f = body.corrected.force;
    for (std::size_t n = 0; n < pieces.of_node.size() && f.size() > 0; ++n)
      if (const int p = pieces.of_node[n]; p >= 0)
        allowed[p] += f.segment<3>(3 * static_cast<Eigen::Index>(n)).dot(body.state.x[n] - watched.x[n]);
    for (int k = 0; k < pieces.count(); ++k)
      out.gained = std::max(out.gained, H[k] - std::max(allowed[k], 0.0));
  }
  label_anew(body, watched);
  watched.x = body.state.x;
  watched.v = body.state.v;
  watched.before = energies(body, watched.pieces, watched.x, watched.v);
  for (int k = 0; k < watched.pieces.count(); ++k) watched.piece[k].energy = watched.before[k];
  if (watched.pieces.count() > 0) out.energy = std::max(out.energy, watched.before.maxCoeff());
}

void TissueWatch::look_at_free(const Body& body, Watched& watched, TissueExtremes& out) {
  const Pieces& pieces = watched.pieces;
  const VecX& f = body.corrected.force;
  for (std::size_t n = 0; n < pieces.of_node.size() && f.size() > 0; ++n)
    if (pieces.of_node[n] >= 0 && !f.segment<3>(3 * static_cast<Eigen::Index>(n)).isZero(0))
      watched.piece[pieces.of_node[n]].since = -1;
  for (int k = 0; k < pieces.count(); ++k) {
    Watched::Piece& p = watched.piece[k];
    if (pieces.held[k]) continue;
    ++out.free;
    if (p.since < 0) {
      p.since = p.energy;
      out.free_energy = std::max(out.free_energy, p.energy);
    } else {
      out.made = std::max(out.made, p.energy - p.since);
    }
  }
}

}  // namespace hapticd
