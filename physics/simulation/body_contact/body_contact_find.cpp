// body_contact.h: which nodes may touch which faces in this step, at its start and as its end shows.
#include <algorithm>
#include <cmath>
#include <iterator>

#include "physics/simulation/body_contact/body_contact.h"

namespace hapticd {
namespace {

constexpr double ahead = 1.2;     // steps of present speed that a node is watched for
constexpr double behind = 0.02;   // of the edge: a face that a node is farther behind is closed to it
constexpr double through = 0.1;   // of the edge: … and from so far behind it never was before it, …
constexpr double against = -0.2;  // … if it does not look against the node's own surface (cosine)

double fastest(const Body& body) {
  double square = 0;
  if (body.deformable && !body.asleep)
    for (const Vec3& v : body.state.v) square = std::max(square, v.squaredNorm());
  return std::sqrt(square);
}

// Of the node before the face's plane when the step began [m].
double height_at_start(const Bodies& bodies, const ContactPair& p, int node, int face) {
  const std::vector<Vec3>& y = bodies[p.faces].state.x;
  const Triangle& t = bodies[p.faces].surface.faces()[face].nodes;
  const Vec3 normal = (y[t[1]] - y[t[0]]).cross(y[t[2]] - y[t[0]]).stableNormalized();
  return normal.dot(bodies[p.points].state.x[node] - y[t[0]]);
}

}  // namespace

bool BodyContacts::names(int body) const {
  return std::any_of(pairs().begin(), pairs().end(),
                     [&](const ContactPair& p) { return p.points == body || p.faces == body; });
}

void BodyContacts::find(const Bodies& bodies) {
  report_ = {};
  candidates_.clear();
  if (empty()) return;
  solved_.clear();
  finder_.begin_step(bodies);
  const auto present = [&](int b) { return std::span<const Vec3>(bodies[b].state.x); };
  for (int k = 0; k < static_cast<int>(pairs().size()); ++k) {
    const ContactPair& p = pairs()[k];
    const Body &own = bodies[p.points], &theirs = bodies[p.faces];
    if (!moves(own) && !moves(theirs)) continue;
    const double depth = depth_of(bodies, p), least = reference_margin * depth, speed = fastest(theirs);
    const auto margin = [&](int, int n) {
      const double v = speed + (moves(own) ? own.state.v[n].norm() : 0);
      return std::min(depth, least + ahead * h_ * v);
    };
    finder_.find(bodies, k, present, margin, depth, least, candidates_);
  }
  drop_ghosts(bodies, true, candidates_);
  const auto capacity = static_cast<std::size_t>(max_body_contacts);
  if (candidates_.size() > capacity) {
    // Those that touched stay; then the nearest. What this leaves out joins when it turns out to matter.
    const auto touched = [&](const BodyContactCandidate& e) {
      return std::any_of(memory_.begin(), memory_.end(), [&](const Remembered& m) {
        return m.pair == e.pair && m.node == e.node && !m.lambda.isZero(0);
      });
    };
    std::vector<std::pair<std::pair<bool, double>, std::size_t>> order;
    for (std::size_t i = 0; i < candidates_.size(); ++i)
      order.push_back({{!touched(candidates_[i]), candidates_[i].gap}, i});
    std::sort(order.begin(), order.end());
    order.resize(capacity);
    std::sort(order.begin(), order.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
    std::vector<BodyContactCandidate> kept;
    for (const auto& [key, i] : order) kept.push_back(std::move(candidates_[i]));
    candidates_ = std::move(kept);
  }
  index_contact_nodes(bodies);
}

// The far side of what is thin: a node far behind a face that did not hold it never was before it. all: even
// where no other face is left.
void BodyContacts::drop_ghosts(const Bodies& bodies, bool all,
                               std::vector<BodyContactCandidate>& found) const {
  if (first_) return;
  for (BodyContactCandidate& e : found) {
    const ContactPair& p = pairs()[e.pair];
    const SurfaceNormals& normals = finder_.normals(p.faces);
    const double far = -through * depth_of(bodies, p);
    const auto known = remembered(e.pair, e.node);
    const Vec3& own_normal = finder_.normals(p.points).node(e.node);
    const auto is_ghost = [&](int f) {
      return normals.face[f].dot(own_normal) > against && height_at_start(bodies, p, e.node, f) < far &&
             normals.distance(bodies[p.faces], f, bodies[p.points].state.x[e.node], bodies[p.faces].state.x) <
                 far &&
             std::none_of(known.begin(), known.end(), [&](const Remembered& m) {
               return m.face == bodies[p.faces].surface.faces()[f].id;
             });
    };
    if (all || !std::all_of(e.faces.begin(), e.faces.end(), is_ghost)) std::erase_if(e.faces, is_ghost);
  }
  std::erase_if(found, [](const BodyContactCandidate& e) { return e.faces.empty(); });
}

bool BodyContacts::touching(int a, int b) const {
  return std::any_of(candidates_.begin(), candidates_.end(), [&](const BodyContactCandidate& e) {
    const ContactPair& p = pairs()[e.pair];
    return (p.points == a && p.faces == b) || (p.points == b && p.faces == a);
  });
}

void BodyContacts::index_contact_nodes(const Bodies& bodies) {
  contact_nodes_.resize(bodies.size());
  for (auto& nodes : contact_nodes_) nodes.clear();
  for (const BodyContactCandidate& e : candidates_) {
    const ContactPair& p = pairs()[e.pair];
    if (bodies[p.points].deformable) contact_nodes_[p.points].push_back(e.node);
    if (bodies[p.faces].deformable)
      for (const int f : e.faces)
        for (const int n : bodies[p.faces].surface.faces()[f].nodes) contact_nodes_[p.faces].push_back(n);
  }
  for (auto& nodes : contact_nodes_) {
    std::sort(nodes.begin(), nodes.end());
    nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  }
  report_.nodes = static_cast<int>(candidates_.size());
}

void BodyContacts::open_faces(const Bodies& bodies) {
  for (BodyContactCandidate& e : candidates_) {
    const ContactPair& p = pairs()[e.pair];
    e.open.clear();
    for (const int f : e.faces)
      if (height_at_start(bodies, p, e.node, f) > -behind * depth_of(bodies, p) ||
          std::find(e.forced.begin(), e.forced.end(), f) != e.forced.end())
        e.open.push_back(f);
    if (e.open.empty()) e.open = e.faces;
  }
}

int BodyContacts::join_missed(const Bodies& bodies, const Positions& x_end) {
  std::vector<BodyContactCandidate> found;
  for (int k = 0; k < static_cast<int>(pairs().size()); ++k) {
    const ContactPair& p = pairs()[k];
    if (!moves(bodies[p.points]) && !moves(bodies[p.faces])) continue;
    const double depth = depth_of(bodies, p);
    const auto margin = [&](int, int) { return reference_margin * depth; };
    finder_.find(bodies, k, x_end, margin, depth, reference_margin * depth, found);
  }
  drop_ghosts(bodies, false, found);
  // Where one is inside that was not to be met, those that are near join with it: one attempt for many.
  const auto known = [&](const BodyContactCandidate& e) {
    return std::find_if(candidates_.begin(), candidates_.end(), [&](const BodyContactCandidate& other) {
      return other.pair == e.pair && other.node == e.node && other.piece == e.piece;
    });
  };
  int joined = 0;
  bool missing = false;
  for (const BodyContactCandidate& e : found) {
    if (e.gap >= -missed) continue;
    const auto k = known(e);
    if (k == candidates_.end() ||
        !std::includes(k->faces.begin(), k->faces.end(), e.faces.begin(), e.faces.end())) {
      missing = true;
      continue;
    }
    // Behind a ghost alone: what is looked for is nearer.
    if (!std::binary_search(e.faces.begin(), e.faces.end(), e.nearest)) continue;
    // Deeper than its recovery allows, through a face that turned in the step.
    if (std::find(k->open.begin(), k->open.end(), e.nearest) != k->open.end() ||
        e.gap >= std::min(0.0, k->gap + settings_.recovery_speed * h_) - missed)
      continue;
    k->forced.push_back(e.nearest);
    ++joined;
    missing = true;
  }
  if (!missing) return 0;
  // A node that slid past the faces it was to meet: those it came to join.
  std::erase_if(found, [&](const BodyContactCandidate& e) {
    const auto k = known(e);
    if (k == candidates_.end()) return false;
    std::vector<int> both;
    std::set_union(k->faces.begin(), k->faces.end(), e.faces.begin(), e.faces.end(),
                   std::back_inserter(both));
    joined += both.size() > k->faces.size();
    k->faces = std::move(both);
    return true;
  });
  const auto capacity = static_cast<std::size_t>(max_body_contacts);
  if (candidates_.size() + found.size() > capacity) {
    std::vector<std::uint8_t> pressed(candidates_.size(), 0);
    for (const BodyContact& c : solved_) pressed[c.candidate] |= c.lambda[0] > 0;
    std::vector<BodyContactCandidate> kept;
    for (std::size_t i = 0; i < candidates_.size(); ++i)
      if (pressed[i]) kept.push_back(std::move(candidates_[i]));
    candidates_ = std::move(kept);
  }
  std::sort(found.begin(), found.end(),
            [](const BodyContactCandidate& a, const BodyContactCandidate& b) { return a.gap < b.gap; });
  const std::size_t room = capacity - std::min(capacity, candidates_.size());
  if (found.size() > room) found.resize(room);
  for (BodyContactCandidate& e : found) {
    e.margin = reference_margin * depth_of(bodies, pairs()[e.pair]);
    candidates_.push_back(std::move(e));
  }
  joined += static_cast<int>(found.size());
  const BodyContactReport before = report_;
  index_contact_nodes(bodies);
  report_.joined = before.joined + joined;
  return joined;
}

}  // namespace hapticd
