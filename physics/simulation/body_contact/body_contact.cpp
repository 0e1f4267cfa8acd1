#include "physics/simulation/body_contact/body_contact.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

namespace hapticd {
namespace {

constexpr double reference_margin = 0.05;  // of the nodes' mean edge: what bodies at rest may move in a step
constexpr double ahead = 1.2;              // steps of present speed that a node is watched for
constexpr double same_place = 1e-3;        // of the edge: nearer than that to an edge, its pseudo-normal
constexpr double missed = 1e-6;            // overlap that makes a node join [m]
constexpr double behind = 0.02;       // of the edge: a face that a node is farther behind is closed to it
constexpr double through = 0.1;       // of the edge: … and from so far behind it never was before it
constexpr double same_contact = 0.9;  // cosine of normals that may hand λ on

bool moves(const Body& body) { return body.deformable && !body.asleep; }

double fastest(const Body& body) {
  double square = 0;
  if (moves(body))
    for (const Vec3& v : body.state.v) square = std::max(square, v.squaredNorm());
  return std::sqrt(square);
}

double depth_of(const Bodies& bodies, const ContactPair& p) {
  return std::min(bodies[p.points].edge, bodies[p.faces].edge);
}

// Of the node before the face's plane when the step began [m].
double height_at_start(const Bodies& bodies, const ContactPair& p, int node, int face) {
  const auto& y = bodies[p.faces].state.x;
  const Triangle& t = bodies[p.faces].surface.faces()[face].nodes;
  const Vec3 normal = (y[t[1]] - y[t[0]]).cross(y[t[2]] - y[t[0]]).stableNormalized();
  return normal.dot(bodies[p.points].state.x[node] - y[t[0]]);
}

}  // namespace

BodyContacts::BodyContacts(BodyContactSettings settings, double h)
    : settings_(std::move(settings)), h_(h), finder_(settings_.pairs) {
  if (empty()) return;
  const bool frictionless = std::all_of(settings_.pairs.begin(), settings_.pairs.end(),
                                        [](const ContactPair& p) { return p.friction <= 0; });
  rows_per_contact_ = frictionless ? 1 : 3;
  lcp_ = std::make_unique<LcpWorkspace>();
  coulomb_ = std::make_unique<CoulombWorkspace>();
}

void BodyContacts::find(const Bodies& bodies) {
  report_ = {};
  candidates_.clear();
  if (empty()) return;
  solved_.clear();
  finder_.follow(bodies);
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
    finder_.find(bodies, k, present, margin, depth, 0, least, candidates_);
  }
  drop_ghosts(bodies, candidates_);
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

// The far side of what is thin: a node far behind a face that did not hold it never was before it.
void BodyContacts::drop_ghosts(const Bodies& bodies, std::vector<BodyContactCandidate>& found) const {
  if (first_) return;
  for (BodyContactCandidate& e : found) {
    const ContactPair& p = pairs()[e.pair];
    const double far = -through * depth_of(bodies, p);
    std::erase_if(e.faces, [&](int f) {
      return height_at_start(bodies, p, e.node, f) < far &&
             std::none_of(memory_.begin(), memory_.end(), [&](const Remembered& m) {
               return m.pair == e.pair && m.node == e.node && m.face == bodies[p.faces].surface.faces()[f].id;
             });
    });
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

void BodyContacts::set_domains(const Bodies& bodies, std::span<const PatchNode> patch) {
  patch_.assign(patch.begin(), patch.end());
  domains_.resize(bodies.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Domain& d = domains_[b];
    d.mobile = moves(bodies[b]);
    d.nodes.clear();
    d.place.assign(bodies[b].state.x.size(), -1);
    if (!d.mobile) continue;
    const auto add = [&](int n) {
      if (d.place[n] >= 0) return;
      d.place[n] = static_cast<int>(d.nodes.size());
      d.nodes.push_back(n);
    };
    for (const PatchNode& p : patch)
      if (p.body == static_cast<int>(b)) add(p.node);
    for (const int n : contact_nodes_[b]) add(n);
  }
}

const Vec3& BodyContacts::position(const Bodies& bodies, int b, int node,
                                   std::vector<Vec3> Domain::*at) const {
  const Domain& d = domains_[b];
  return d.mobile && d.place[node] >= 0 ? (d.*at)[d.place[node]] : bodies[b].state.x[node];
}

Vec3 BodyContacts::relative(const Bodies& bodies, const BodyContact& c, std::vector<Vec3> Domain::*at) const {
  Vec3 out = Vec3::Zero();
  for (int t = 0; t < 4; ++t)
    out += c.stencil[t].weight * position(bodies, c.stencil[t].body, c.mesh_node[t], at);
  return out;
}

void BodyContacts::set_free_motion(const Bodies& bodies) {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Domain& d = domains_[b];
    if (!d.mobile) continue;
    const auto size = static_cast<Eigen::Index>(3 * d.nodes.size());
    d.tool.setZero(size);
    d.force.setZero(size);
    d.start.clear();
    d.free.clear();
    for (const int n : d.nodes) {
      d.start.push_back(bodies[b].state.x[n]);
      d.free.push_back(bodies[b].state.x[n] + bodies[b].free.dx.segment<3>(3 * n));
    }
    d.linear = d.start;
  }
  open_faces(bodies);
  rows_.clear();
  solved_.clear();
  linearise(bodies);
  // At the start of the step: overlap of each node, from which its recovery is measured.
  for (BodyContactCandidate& e : candidates_) {
    e.gap = 0;
    for (const BodyContact& c : rows_)
      if (c.pair == e.pair && c.node == e.node) e.gap = std::min(e.gap, c.gap);
  }
  for (BodyContact& c : rows_)
    for (const BodyContactCandidate& e : candidates_)
      if (c.pair == e.pair && c.node == e.node) {
        const double allowed = std::min(0.0, e.gap + settings_.recovery_speed * h_);
        c.delta_free[0] += c.allowed - allowed;
        c.allowed = allowed;
      }
}

void BodyContacts::open_faces(const Bodies& bodies) {
  for (BodyContactCandidate& e : candidates_) {
    const ContactPair& p = pairs()[e.pair];
    e.open.clear();
    for (const int f : e.faces)
      if (height_at_start(bodies, p, e.node, f) > -behind * depth_of(bodies, p)) e.open.push_back(f);
    if (e.open.empty()) e.open = e.faces;
  }
}

void BodyContacts::start_from(int body, std::span<const Vec3> x) {
  Domain& d = domains_[body];
  for (std::size_t k = 0; k < d.nodes.size(); ++k) d.linear[k] = x[d.nodes[k]];
}

// One for each touch at the linearisation point.
void BodyContacts::find_rows(const Bodies& bodies, std::vector<BodyContact>& rows) const {
  std::vector<ContactFace> views;
  std::array<VertexFaceContact, max_vertex_face_contacts> touch;
  for (const BodyContactCandidate& e : candidates_) {
    const ContactPair& p = pairs()[e.pair];
    const auto& faces = bodies[p.faces].surface.faces();
    views.clear();
    for (const int f : e.open) {
      std::array<Vec3, 3> x;
      for (int c = 0; c < 3; ++c) x[c] = position(bodies, p.faces, faces[f].nodes[c], &Domain::linear);
      views.push_back(finder_.normals(p.faces).contact_face(bodies[p.faces], f, x));
    }
    const Vec3& x = position(bodies, p.points, e.node, &Domain::linear);
    const double edge = depth_of(bodies, p);
    int held = -1;
    for (std::size_t k = 0; k < e.open.size(); ++k)
      for (const Remembered& m : memory_)
        if (m.pair == e.pair && m.node == e.node && m.face == faces[e.open[k]].id) held = static_cast<int>(k);
    const int count = find_vertex_face_contacts(x, views, same_place * edge, held, touch);
    for (int k = 0; k < count; ++k) {
      const VertexFaceContact& t = touch[k];
      if (k > 0 && t.gap > std::max(e.margin, reference_margin * edge)) continue;
      const SurfaceFace& face = faces[e.open[t.face]];
      BodyContact c;
      c.pair = e.pair;
      c.node = e.node;
      c.face = face.id;
      c.mesh_node = {e.node, face.nodes[0], face.nodes[1], face.nodes[2]};
      bool mobile = false;
      for (int i = 0; i < 4; ++i) {
        const int b = i == 0 ? p.points : p.faces;
        c.stencil[i] = {b, domains_[b].mobile ? domains_[b].place[c.mesh_node[i]] : -1,
                        i == 0 ? 1 : -t.weight[i - 1]};
        mobile = mobile || (c.stencil[i].place >= 0 && !bodies[b].model.fixed[c.mesh_node[i]]);
      }
      if (!mobile) continue;
      c.frame = contact_frame(t.normal);
      c.friction = p.friction;
      c.gap = t.gap;
      c.allowed = std::min(0.0, e.gap + settings_.recovery_speed * h_);
      const Vec3 start = relative(bodies, c, &Domain::start), free = relative(bodies, c, &Domain::free);
      c.delta_free = c.frame.transpose() * (free - start);
      c.delta_free[0] = c.gap + t.normal.dot(free - relative(bodies, c, &Domain::linear)) - c.allowed;
      c.lambda.setZero();
      rows.push_back(c);
    }
  }
}

double BodyContacts::linearise(const Bodies& bodies) {
  rows_.clear();
  find_rows(bodies, rows_);
  warm_start(rows_);
  choose(rows_);
  double off = 0;
  report_.penetration = 0;
  for (const BodyContact& c : rows_) {
    report_.penetration = std::max(report_.penetration, -c.gap);
    off = std::max(off, c.lambda[0] > 0 ? std::abs(c.gap - c.allowed) : c.allowed - c.gap);
  }
  return off;
}

double BodyContacts::add_violated(const Bodies& bodies, double tolerance) {
  std::vector<BodyContact> found;
  find_rows(bodies, found);
  rows_ = solved_;
  double deepest = 0;
  report_.penetration = 0;
  for (const BodyContact& c : found) {
    report_.penetration = std::max(report_.penetration, -c.gap);
    if (c.gap >= c.allowed - tolerance) continue;
    deepest = std::max(deepest, c.allowed - c.gap);
    rows_.push_back(c);
  }
  return deepest;
}

void BodyContacts::warm_start(std::vector<BodyContact>& rows) const {
  std::vector<std::uint8_t> taken(memory_.size(), 0);
  const auto take = [&](BodyContact& c, bool same_face) {
    int best = -1;
    double nearest = same_contact;
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      const Remembered& m = memory_[i];
      if (taken[i] || m.pair != c.pair || m.node != c.node || (same_face && m.face != c.face)) continue;
      const double cosine = m.normal.dot(c.frame.col(0));
      if (!(cosine > nearest)) continue;
      nearest = cosine;
      best = static_cast<int>(i);
    }
    if (best < 0) return;
    taken[best] = 1;
    c.lambda = c.frame.transpose() * memory_[best].lambda;
  };
  for (BodyContact& c : rows) take(c, true);
  for (BodyContact& c : rows)
    if (c.lambda.isZero(0)) take(c, false);
  for (BodyContact& c : rows) c.lambda = project_on_cone(c.lambda, c.friction);
}

void BodyContacts::choose(std::vector<BodyContact>& rows) {
  report_.dropped = 0;
  const auto capacity = static_cast<std::size_t>(max_body_contacts);
  if (rows.size() <= capacity) return;
  // Before the first solve only the free motion tells how deep a touch will be; after it, the gap does.
  const bool first = solved_.empty();
  const auto depth = [&](const BodyContact& c) { return first ? c.delta_free[0] : c.gap - c.allowed; };
  std::stable_sort(rows.begin(), rows.end(), [&](const BodyContact& a, const BodyContact& b) {
    const bool a_carries = a.lambda[0] > 0, b_carries = b.lambda[0] > 0;
    return a_carries != b_carries ? a_carries : depth(a) < depth(b);
  });
  report_.dropped =
      static_cast<int>(std::count_if(rows.begin() + static_cast<std::ptrdiff_t>(capacity), rows.end(),
                                     [](const BodyContact& c) { return c.gap < c.allowed - missed; }));
  rows.resize(capacity);
}

void BodyContacts::remember() {
  first_ = false;
  memory_.clear();
  for (const BodyContact& c : solved_)
    if (c.lambda[0] > 0) memory_.push_back({c.pair, c.node, c.face, c.frame.col(0), c.frame * c.lambda});
}

int BodyContacts::join_missed(const Bodies& bodies, const Positions& x_end) {
  std::vector<BodyContactCandidate> found;
  for (int k = 0; k < static_cast<int>(pairs().size()); ++k) {
    const ContactPair& p = pairs()[k];
    if (!moves(bodies[p.points]) && !moves(bodies[p.faces])) continue;
    double moved = 0;
    for (const int b : {p.points, p.faces}) {
      double square = 0;
      for (std::size_t n = 0; n < x_end(b).size(); ++n)
        square = std::max(square, (x_end(b)[n] - bodies[b].state.x[n]).squaredNorm());
      moved += std::sqrt(square);
    }
    const double depth = depth_of(bodies, p);
    const auto margin = [](int, int) { return -missed; };
    finder_.find(bodies, k, x_end, margin, depth, moved, reference_margin * depth, found);
  }
  drop_ghosts(bodies, found);
  int joined = 0;
  // A node that slid past the faces it was to meet: those it came to join.
  std::erase_if(found, [&](BodyContactCandidate& e) {
    const auto known = std::find_if(
        candidates_.begin(), candidates_.end(),
        [&](const BodyContactCandidate& other) { return other.pair == e.pair && other.node == e.node; });
    if (known == candidates_.end()) return false;
    std::vector<int> both;
    std::set_union(known->faces.begin(), known->faces.end(), e.faces.begin(), e.faces.end(),
                   std::back_inserter(both));
    joined += both.size() > known->faces.size();
    known->faces = std::move(both);
    return true;
  });
  if (found.empty() && joined == 0) return 0;
  const auto capacity = static_cast<std::size_t>(max_body_contacts);
  if (candidates_.size() + found.size() > capacity)
    std::erase_if(candidates_, [&](const BodyContactCandidate& e) {
      return std::none_of(solved_.begin(), solved_.end(), [&](const BodyContact& c) {
        return c.pair == e.pair && c.node == e.node && c.lambda[0] > 0;
      });
    });
  std::sort(found.begin(), found.end(),
            [](const BodyContactCandidate& a, const BodyContactCandidate& b) { return a.gap < b.gap; });
  const std::size_t room = capacity - std::min(capacity, candidates_.size());
  if (found.size() > room) found.resize(room);
  for (BodyContactCandidate& e : found) {
    e.margin = reference_margin * depth_of(bodies, pairs()[e.pair]);
    candidates_.push_back(std::move(e));
  }
  joined += static_cast<int>(found.size());
  if (joined == 0) return 0;
  const BodyContactReport before = report_;
  index_contact_nodes(bodies);
  report_.joined = before.joined + joined;
  return joined;
}

}  // namespace hapticd
