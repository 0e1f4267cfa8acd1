#include "physics/simulation/body_contact/body_contact.h"

#include <algorithm>
#include <cmath>

namespace hapticd {
namespace {

constexpr double same_place = 1e-3;   // of the edge: nearer than that to an edge, its pseudo-normal
constexpr double ways_ahead = 3;      // of the last round, that a candidate is looked at for
constexpr double same_contact = 0.9;  // cosine of normals that may hand λ on

}  // namespace

bool BodyContacts::moves(const Body& body) { return body.deformable && !body.asleep; }

double BodyContacts::depth_of(const Bodies& bodies, const ContactPair& p) {
  return std::min(bodies[p.points].edge, bodies[p.faces].edge);
}

BodyContacts::BodyContacts(BodyContactSettings settings, double h)
    : settings_(std::move(settings)), h_(h), finder_(settings_.pairs) {
  if (empty()) return;
  const bool frictionless = std::all_of(settings_.pairs.begin(), settings_.pairs.end(),
                                        [](const ContactPair& p) { return p.friction <= 0; });
  rows_per_contact_ = frictionless ? 1 : 3;
  lcp_ = std::make_unique<LcpWorkspace>();
  coulomb_ = std::make_unique<CoulombWorkspace>(max_contacts, false);
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
  travelled_ = last_way_ = 0;
  for (BodyContactCandidate& e : candidates_) e.looked_at = 0;
  open_faces(bodies);
  rows_.clear();
  solved_.clear();
  linearise(bodies);
  // At the start of the step: overlap of each node, from which its recovery is measured.
  for (BodyContactCandidate& e : candidates_) e.gap = 0;
  for (const BodyContact& c : rows_) {
    BodyContactCandidate& e = candidates_[c.candidate];
    e.gap = std::min(e.gap, c.gap);
  }
  for (BodyContact& c : rows_) {
    const double allowed = std::min(0.0, candidates_[c.candidate].gap + settings_.recovery_speed * h_);
    c.delta_free[0] += c.allowed - allowed;
    c.allowed = allowed;
  }
}

void BodyContacts::pull(const VecX& force) {
  if (force.isZero(0)) return;
  set_tool(force);
  find_moved();
  for (std::size_t b = 0; b < domains_.size(); ++b) {
    Domain& d = domains_[b];
    if (!d.mobile) continue;
    for (std::size_t k = 0; k < d.free.size(); ++k)
      d.free[k] += moved_[b].segment<3>(3 * static_cast<Eigen::Index>(k));
    d.tool.setZero();
  }
}

void BodyContacts::start_from(int body, std::span<const Vec3> x) {
  Domain& d = domains_[body];
  std::vector<Vec3> to;
  for (const int n : d.nodes) to.push_back(x[n]);
  last_way_ = std::max(last_way_, travel(d, to));
}

VecX BodyContacts::linearisation_point() const {
  Eigen::Index size = 0, at = 0;
  for (const Domain& d : domains_) size += 3 * static_cast<Eigen::Index>(d.linear.size()) * d.mobile;
  VecX x(size);
  for (const Domain& d : domains_)
    if (d.mobile)
      for (const Vec3& place : d.linear) {
        x.segment<3>(at) = place;
        at += 3;
      }
  return x;
}

void BodyContacts::go_to(const VecX& x) {
  Eigen::Index at = 0;
  double way = 0;
  for (Domain& d : domains_) {
    if (!d.mobile) continue;
    std::vector<Vec3> to(d.linear.size());
    for (Vec3& place : to) {
      place = x.segment<3>(at);
      at += 3;
    }
    way = std::max(way, travel(d, to));
  }
  last_way_ += way;
}

// Returns the longest way of anything there against anything that moves as much.
double BodyContacts::travel(Domain& d, std::span<const Vec3> x) {
  double square = 0;
  for (std::size_t k = 0; k < d.nodes.size(); ++k) {
    square = std::max(square, (x[k] - d.linear[k]).squaredNorm());
    d.linear[k] = x[k];
  }
  return 2 * std::sqrt(square);  // both sides of a gap may move by as much
}

std::span<const BodyContacts::Remembered> BodyContacts::remembered(int pair, int node) const {
  struct Key {
    int pair, node;
  };
  struct Order {
    bool operator()(const Remembered& m, const Key& k) const {
      return m.pair != k.pair ? m.pair < k.pair : m.node < k.node;
    }
    bool operator()(const Key& k, const Remembered& m) const {
      return m.pair != k.pair ? k.pair < m.pair : k.node < m.node;
    }
  };
  const auto [first, last] = std::equal_range(memory_.begin(), memory_.end(), Key{pair, node}, Order{});
  return {first, last};
}

// One for each touch at the linearisation point; of candidates too far apart to overlap before the bodies
// have travelled another `ahead` of their last way, none.
void BodyContacts::find_rows(const Bodies& bodies, double ahead, std::vector<BodyContact>& rows) {
  travelled_ += last_way_;
  const double horizon = travelled_ + ahead * last_way_;
  std::vector<ContactFace> views;
  std::array<VertexFaceContact, max_vertex_face_contacts> touch;
  for (BodyContactCandidate& e : candidates_) {
    if (horizon < e.looked_at) continue;
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
    const auto known = remembered(e.pair, e.node);
    for (std::size_t k = 0; !known.empty() && k < e.open.size(); ++k)
      for (const Remembered& m : known)
        if (m.face == faces[e.open[k]].id) held = static_cast<int>(k);
    const int count = find_vertex_face_contacts(x, views, same_place * edge, held, touch);
    e.looked_at = travelled_;
    if (count > 0) e.looked_at += std::max(0.0, touch[0].gap);
    for (int k = 1; k < count; ++k)
      e.looked_at = std::min(e.looked_at, travelled_ + std::max(0.0, touch[k].gap));
    for (int k = 0; k < count; ++k) {
      const VertexFaceContact& t = touch[k];
      if (k > 0 && t.gap > std::max(e.margin, reference_margin * edge)) continue;
      const SurfaceFace& face = faces[e.open[t.face]];
      BodyContact c;
      c.candidate = static_cast<int>(&e - candidates_.data());
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
  last_way_ = 0;
}

double BodyContacts::linearise(const Bodies& bodies) {
  rows_.clear();
  find_rows(bodies, ways_ahead, rows_);
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
  find_rows(bodies, 0, found);
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
    const Remembered* best = nullptr;
    double nearest = same_contact;
    for (const Remembered& m : remembered(c.pair, c.node)) {
      if (taken[&m - memory_.data()] || (same_face && m.face != c.face)) continue;
      const double cosine = m.normal.dot(c.frame.col(0));
      if (!(cosine > nearest)) continue;
      nearest = cosine;
      best = &m;
    }
    if (!best) return;
    taken[best - memory_.data()] = 1;
    c.lambda = c.frame.transpose() * best->lambda;
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
  std::stable_sort(memory_.begin(), memory_.end(), [](const Remembered& a, const Remembered& b) {
    return a.pair != b.pair ? a.pair < b.pair : a.node < b.node;
  });
}

}  // namespace hapticd
