#include "physics/simulation/cutting/cutting_stage.h"

#include <algorithm>
#include <utility>

#include "physics/contact/cutting/edge_rows.h"
#include "physics/cutting/breaking.h"
#include "physics/cutting/opening.h"
#include "physics/cutting/tearing.h"

namespace hapticd {
namespace {

// A strip reaches past its outer samples, and back over where a cut begins at the surface, by this part of a
// sample's width: a strip that ends on a mesh edge's own line would leave it whole.
constexpr double overlap = 0.05;

std::uint64_t front_id(int instrument, int k, const CutFront& front) noexcept {
  return edge_id(instrument, static_cast<int>(front.number % (1u << 24)) * max_edge_samples + k);
}

// How far a run's strip goes beyond its outer front: half a sample where the blade ends; where it goes on and
// has no tissue ahead of it, out of the tissue, for what bulges ends nearer in the rest shape. along: one
// sample on, in the rest shape.
Vec3 beyond(const Body& body, const MaterialPoint& front, const Vec3& along, std::size_t samples_left) {
  constexpr std::size_t most = 2;
  Vec3 reach = 0.5 * along;
  if (samples_left > 0) {
    MaterialPoint end = front;
    walk(body.model, body.state, end, (0.5 + static_cast<double>(std::min(samples_left, most))) * along);
    reach = end.rest - front.rest;
  }
  return reach + overlap * along;
}

std::vector<int> nodes_of_clefts(const Body& body) {
  std::vector<int> nodes;
  for (std::size_t id = 0; id < body.tearing.clefts.size(); ++id)
    if (body.tearing.clefts[id])
      for (const int n : outward_face(body.model.mesh.tets[id / 4], static_cast<int>(id % 4)))
        nodes.push_back(n);
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  nodes.reserve(nodes.size() + body.model.node_count());
  return nodes;
}

}  // namespace

CuttingStage::CuttingStage(Instruments instruments, Bodies& bodies) {
  for (int i = 0; i < instruments.count(); ++i) {
    fronts_.emplace_back(instruments[i].blade);
    cuts_anything_ = cuts_anything_ || !instruments[i].blade.sample.empty();
  }
  for (Body& b : bodies) {
    const bool has_room = b.model.node_count() > b.model.nodes_in_use;
    cuts_anything_ = cuts_anything_ || (has_room && b.tearing.toughness > 0);
    cuts_.push_back(has_room ? std::make_unique<CutBody>(b.model, instruments.count()) : nullptr);
    if (has_room) cuts_.back()->cleft_nodes = nodes_of_clefts(b);
  }
}

std::vector<int> CuttingStage::realise(Bodies& bodies, Instruments instruments) {
  std::vector<int> changed;
  if (!cuts_anything_) return changed;
  for (int i = 0; i < instruments.count(); ++i) cut_strips(bodies, instruments[i].blade, i);
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Body& body = bodies[b];
    CutBody* cut = cuts_[b].get();
    if (!cut) continue;
    if (body.tearing.toughness > 0 && !body.asleep) tear(body, *cut);
    if (cut->change.empty()) continue;
    body.surface.follow(body.model, cut->change.tets, cut->change.opened);
    body.asleep = false;
    body.energy.elastic.resize(0);
    ++body.topology;
    changed.push_back(static_cast<int>(b));
  }
  follow(bodies, changed);
  return changed;
}

// Tissue of two sides of a cleft that hangs together by a node or an edge alone, after a crack or a removal,
// comes apart there as well.
void CuttingStage::tear(Body& body, CutBody& cut) {
  std::vector<int> faces = faces_that_tear(body.model, body.state, body.surface, body.tearing);
  const bool thinner = std::exchange(cut.removed_before, body.state.removed) != body.state.removed;
  const std::vector<int> breaking = std::exchange(cut.breaking, {});
  if (cut.change.empty() && cut.removed_then == body.state.removed && cut.cuts_then == body.topology)
    faces.insert(faces.end(), breaking.begin(), breaking.end());
  if (!faces.empty()) note(open_faces(body.model, body.state, cut.work, faces, cut.change));
  if (cut.cleft_nodes.empty() || (cut.change.empty() && !thinner)) return;
  note(part_hinges(body.model, body.state, cut.work, cut.cleft_nodes, cut.change));
  for (const int n : cut.change.nodes) cut.cleft_nodes.push_back(n);
}

void CuttingStage::look_for_cracks(Bodies& bodies) {
  for (std::size_t b = 0; cuts_anything_ && b < bodies.size(); ++b) {
    Body& body = bodies[b];
    CutBody* cut = cuts_[b].get();
    if (!cut || !(body.tearing.toughness > 0) || body.asleep) continue;
    const int removed = std::exchange(cut->removed_then, body.state.removed);
    const int cuts = std::exchange(cut->cuts_then, body.topology);
    if (removed != cut->removed_then || cuts != cut->cuts_then) cut->refused.until = 0;
    cut->breaking =
        faces_that_break(body.model, body.state, body.surface, cut->work, body.tearing, body.corrected.force,
                         &cut->refused, [&](const VecX& f, VecX& dx) { body.compliance->apply(f, dx); });
  }
}

// Runs of neighbouring samples in one body: from where the mesh is cut to where their fronts are.
void CuttingStage::cut_strips(Bodies& bodies, const Blade& blade, int i) {
  std::vector<CutFront>& front = fronts_[i].all();
  const auto is_cutting = [&](std::size_t k) {
    return k < front.size() && front[k].in_tissue && front[k].point.any() && cuts_[front[k].body];
  };
  for (std::size_t first = 0, end = 0; first < front.size(); first = end) {
    end = first + 1;
    if (!is_cutting(first)) continue;
    while (is_cutting(end) && front[end].body == front[first].body) ++end;
    Body& body = bodies[front[first].body];
    CutBody& cut = *cuts_[front[first].body];
    const Mat3 to_rest = deformation_at(body.model, body.state.x, front[first].point).inverse();
    const Vec3 alone = blade.sample[first].width * (to_rest * fronts_[i].along()).normalized();
    std::vector<Vec3> from, to;
    bool advanced = false;
    for (std::size_t k = first; k < end; ++k) {
      CutFront& f = front[k];
      const Vec3 way = f.point.rest - f.cut_to;
      advanced = advanced || !way.isZero(0);
      const double back = f.begun ? 0 : overlap * blade.sample[k].width;  // a cut begins before the surface
      from.push_back(f.cut_to - back * way.stableNormalized());
      to.push_back(f.point.rest);
    }
    if (!advanced) continue;
    if (std::none_of(front.begin(), front.end(), [](const CutFront& f) { return f.begun; }))
      cut.of_blade[i].start();
    cut.strip.clear();
    const Vec3 first_way = end - first > 1 ? Vec3(to[1] - to[0]) : alone;
    const Vec3 last_way = end - first > 1 ? Vec3(to.back() - to[to.size() - 2]) : alone;
    const Vec3 before = beyond(body, front[first].point, -first_way, first);
    const Vec3 after = beyond(body, front[end - 1].point, last_way, front.size() - end);
    for (std::vector<Vec3>* line : {&from, &to}) {
      line->insert(line->begin(), line->front() + before);
      line->push_back(line->back() + after);
    }
    cut.strip.sweep(from, to);
    note(cut.of_blade[i].extend(body.model, body.state, cut.work, cut.strip, cut.change));
    for (std::size_t k = first; k < end; ++k) {
      front[k].cut_to = front[k].point.rest;
      front[k].begun = true;
    }
  }
}

void CuttingStage::note(CutStatus status) { out_of_room_ = out_of_room_ || status == CutStatus::no_room; }

std::vector<int> CuttingStage::around_parted(const Bodies& bodies, int b) {
  std::vector<int> tets;
  CutBody& cut = *cuts_[b];
  const auto add = [&](int node) {
    cut.work.stars.live(bodies[b].state, node, cut.work.star);
    tets.insert(tets.end(), cut.work.star.begin(), cut.work.star.end());
  };
  for (std::size_t k = 0; k < cut.change.nodes.size(); ++k)
    if (const int of = cut.change.node_of[k]; of >= 0) {
      add(cut.change.nodes[k]);
      add(of);
    }
  return tets;
}

void CuttingStage::tell_compliances(Bodies& bodies) {
  if (!cuts_anything_) return;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (!cuts_[b] || cuts_[b]->change.empty()) continue;
    bodies[b].compliance->reshape(bodies[b].state, cuts_[b]->change.tets);
    cuts_[b]->change.clear();
    bodies[b].free.ahead = false;
  }
}

void CuttingStage::follow(const Bodies& bodies, std::span<const int> which) {
  for (CutFronts& fronts : fronts_)
    for (const int b : which) fronts.follow(bodies, b);
}

void CuttingStage::find(const Bodies& bodies, Instruments instruments, const InstrumentPoses& X,
                        double reach) {
  nodes_.clear();
  if (!cuts_anything_) return;
  for (int i = 0; i < instruments.count(); ++i) {
    if (!X.present[i]) {
      fronts_[i].rest();
      continue;
    }
    fronts_[i].find(bodies, instruments[i].blade, X[i], reach);
    for (const CutFront& f : fronts_[i].all()) {
      if (f.body < 0) continue;
      const Tet& tet = bodies[f.body].model.mesh.tets[f.point.tet];
      for (int a = 0; a < 4; ++a)
        if (f.point.weight[a] > 0) nodes_.push_back({f.body, tet[a]});
    }
  }
}

void CuttingStage::publish(const Bodies& bodies, Instruments instruments, const PatchGatherer& patch,
                           CondensedProblem& problem) const {
  problem.edges = 0;
  for (int i = 0; i < instruments.count(); ++i)
    for (std::size_t k = 0; k < fronts_[i].all().size(); ++k) {
      const CutFront& f = fronts_[i].all()[k];
      if (f.body < 0 || problem.edges == max_edge_samples) continue;
      const Body& body = bodies[f.body];
      const Tet& tet = body.model.mesh.tets[f.point.tet];
      EdgeSample e = edge_sample(instruments[i].blade, i, static_cast<int>(k));
      e.id = front_id(i, static_cast<int>(k), f);
      e.body = f.body;
      e.limit = body.toughness * instruments[i].blade.sample[k].width;
      e.viscosity = body.cutting_viscosity * instruments[i].blade.sample[k].width;
      e.advance = f.advance;
      int known = 0;
      for (int a = 0; a < 4; ++a) {
        e.node[a] = f.point.weight[a] > 0 ? patch.index(f.body, tet[a]) : -1;
        e.weight[a] = std::max(f.point.weight[a], 0.0);
        if (e.node[a] >= 0) known = e.node[a];
      }
      // A front whose nodes did not all find room in the patch is not felt in this step.
      bool complete = true;
      for (int a = 0; a < 4; ++a) {
        complete = complete && (e.node[a] >= 0 || e.weight[a] == 0);
        if (e.node[a] < 0) e.node[a] = known;
      }
      if (complete) problem.edge[problem.edges++] = e;
    }
  std::sort(problem.edge.begin(), problem.edge.begin() + problem.edges,
            [](const EdgeSample& a, const EdgeSample& b) { return a.id < b.id; });
}

void CuttingStage::advance(const Bodies& bodies, Instruments instruments, const InstrumentPoses& X,
                           const CondensedProblem& problem, const ContactMemory& memory) {
  for (int e = 0; e < problem.edges; ++e) {
    const EdgeSample& edge = problem.edge[e];
    const int i = edge.instrument;
    if (!X.present[i]) continue;
    const int k = static_cast<int>(edge.id % max_edge_samples);
    const Vec3 d = X[i].q * instruments[i].blade.direction;
    const double way = fronts_[i].advance(bodies, k, d, advance_to_realise(problem, memory, e));
    area_ += instruments[i].blade.sample[k].width * way;
  }
}

}  // namespace hapticd
