#include "physics/simulation/body_contact.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include <Eigen/Cholesky>

#include "physics/simulation/wide_coulomb.h"

namespace hapticd {
namespace {

constexpr double base_margin = 0.05;  // of the nodes' mean edge: what bodies at rest may move in a step
constexpr double ahead = 1.2;         // steps of present speed that a node is watched for
constexpr double same_place = 1e-3;   // of the edge: nearer than that to an edge, its pseudo-normal
constexpr double missed = 1e-6;       // overlap that makes a node join [m]
constexpr double same_contact = 0.9;  // cosine of normals that may hand λ on
constexpr double inside_the_cone = 1 - 1e-6;  // ‖λ_t‖ / (μ λ_n) below which a contact sticks
constexpr double relative_diagonal = 1e-9;
constexpr double closed_gap = 1e-9;   // overlap that makes a contact part of the solve [m]
constexpr int sweeps = 2000;          // no deadline of a millisecond here

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
  encounters_.clear();
  if (empty()) return;
  solved_.clear();
  finder_.follow(bodies);
  const auto present = [&](int b) { return std::span<const Vec3>(bodies[b].state.x); };
  for (int k = 0; k < static_cast<int>(pairs().size()); ++k) {
    const ContactPair& p = pairs()[k];
    const Body &own = bodies[p.points], &theirs = bodies[p.faces];
    if (!moves(own) && !moves(theirs)) continue;
    const double depth = depth_of(bodies, p), least = base_margin * depth, speed = fastest(theirs);
    const auto margin = [&](int, int n) {
      const double v = speed + (moves(own) ? own.state.v[n].norm() : 0);
      return std::min(depth, least + ahead * h_ * v);
    };
    finder_.find(bodies, k, present, margin, depth, 0, least, encounters_);
  }
  const auto capacity = static_cast<std::size_t>(max_body_contacts);
  if (encounters_.size() > capacity) {
    // Those that touched stay; then the nearest. What this leaves out joins when it turns out to matter.
    const auto touched = [&](const Encounter& e) {
      return std::any_of(memory_.begin(), memory_.end(), [&](const Remembered& m) {
        return m.pair == e.pair && m.node == e.node && !m.lambda.isZero(0);
      });
    };
    std::vector<std::pair<std::pair<bool, double>, std::size_t>> order;
    for (std::size_t i = 0; i < encounters_.size(); ++i)
      order.push_back({{!touched(encounters_[i]), encounters_[i].gap}, i});
    std::sort(order.begin(), order.end());
    order.resize(capacity);
    std::sort(order.begin(), order.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
    std::vector<Encounter> kept;
    for (const auto& [key, i] : order) kept.push_back(std::move(encounters_[i]));
    encounters_ = std::move(kept);
  }
  index_contact_nodes(bodies);
}

bool BodyContacts::touching(int a, int b) const {
  return std::any_of(encounters_.begin(), encounters_.end(), [&](const Encounter& e) {
    const ContactPair& p = pairs()[e.pair];
    return (p.points == a && p.faces == b) || (p.points == b && p.faces == a);
  });
}

void BodyContacts::index_contact_nodes(const Bodies& bodies) {
  contact_nodes_.resize(bodies.size());
  for (auto& nodes : contact_nodes_) nodes.clear();
  for (const Encounter& e : encounters_) {
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
  report_.nodes = static_cast<int>(encounters_.size());
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
    out += c.lever[t].weight * position(bodies, c.lever[t].body, c.mesh_node[t], at);
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
      d.free.push_back(bodies[b].state.x[n] + bodies[b].dx_free.segment<3>(3 * n));
    }
    d.linear = d.start;
  }
  open_faces(bodies);
  relax_ = 1;
  rows_.clear();
  solved_.clear();
  linearise(bodies);
  // At the start of the step: overlap of each node, from which its recovery is measured.
  for (Encounter& e : encounters_) {
    e.gap = 0;
    for (const BodyContact& c : rows_)
      if (c.pair == e.pair && c.node == e.node) e.gap = std::min(e.gap, c.gap);
  }
  for (BodyContact& c : rows_)
    for (const Encounter& e : encounters_)
      if (c.pair == e.pair && c.node == e.node) {
        const double allowed = std::min(0.0, e.gap + settings_.recovery_speed * h_);
        c.delta_free[0] += c.allowed - allowed;
        c.allowed = allowed;
      }
}

void BodyContacts::open_faces(const Bodies& bodies) {
  for (Encounter& e : encounters_) {
    const ContactPair& p = pairs()[e.pair];
    const auto& faces = bodies[p.faces].surface.faces();
    const auto& y = bodies[p.faces].state.x;
    const Vec3& x = bodies[p.points].state.x[e.node];
    const double behind = -same_place * depth_of(bodies, p);
    e.open.clear();
    for (const int f : e.faces) {
      const Triangle& t = faces[f].nodes;
      const Vec3 normal = (y[t[1]] - y[t[0]]).cross(y[t[2]] - y[t[0]]).stableNormalized();
      if (normal.dot(x - y[t[0]]) > behind) e.open.push_back(f);
    }
    if (e.open.empty()) e.open = e.faces;
  }
}

double BodyContacts::linearise(const Bodies& bodies) {
  rows_.clear();
  std::vector<TouchFace> views;
  std::array<Touch, max_touches> touch;
  for (const Encounter& e : encounters_) {
    const ContactPair& p = pairs()[e.pair];
    const auto& faces = bodies[p.faces].surface.faces();
    views.clear();
    for (const int f : e.open) {
      std::array<Vec3, 3> x;
      for (int c = 0; c < 3; ++c) x[c] = position(bodies, p.faces, faces[f].nodes[c], &Domain::linear);
      views.push_back(finder_.normals(p.faces).touch_face(bodies[p.faces], f, x));
    }
    const Vec3& x = position(bodies, p.points, e.node, &Domain::linear);
    const double edge = depth_of(bodies, p);
    int held = -1;
    for (std::size_t k = 0; k < e.open.size(); ++k)
      for (const Remembered& m : memory_)
        if (m.pair == e.pair && m.node == e.node && m.face == faces[e.open[k]].id) held = static_cast<int>(k);
    const int count = find_touches(x, views, same_place * edge, held, touch);
    for (int k = 0; k < count; ++k) {
      const Touch& t = touch[k];
      if (k > 0 && t.gap > std::max(e.margin, base_margin * edge)) continue;
      const SurfaceFace& face = faces[e.open[t.face]];
      BodyContact c;
      c.pair = e.pair;
      c.node = e.node;
      c.face = face.id;
      c.mesh_node = {e.node, face.nodes[0], face.nodes[1], face.nodes[2]};
      bool mobile = false;
      for (int i = 0; i < 4; ++i) {
        const int b = i == 0 ? p.points : p.faces;
        c.lever[i] = {b, domains_[b].mobile ? domains_[b].place[c.mesh_node[i]] : -1,
                      i == 0 ? 1 : -t.weight[i - 1]};
        mobile = mobile || (c.lever[i].place >= 0 && !bodies[b].model.fixed[c.mesh_node[i]]);
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
      rows_.push_back(c);
    }
  }
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

Mat3 BodyContacts::between(std::span<const Lever> a, std::span<const Lever> b) const {
  Mat3 G = Mat3::Zero();
  for (const Lever& s : a) {
    if (s.place < 0) continue;
    for (const Lever& t : b)
      if (t.place >= 0 && s.body == t.body)
        G += s.weight * t.weight * domains_[s.body].C.block<3, 3>(3 * s.place, 3 * t.place);
  }
  return G;
}

// The rows to begin with: those that carried force; where none did, those that the free motion closes.
void BodyContacts::choose_working() {
  solved_ = rows_;
  working_.clear();
  works_.assign(solved_.size(), -1);
  const bool known =
      std::any_of(solved_.begin(), solved_.end(), [](const auto& c) { return c.lambda[0] > 0; });
  for (int i = 0; i < static_cast<int>(solved_.size()); ++i)
    if (known ? solved_[i].lambda[0] > 0 : solved_[i].delta_free[0] < 0) {
      works_[i] = static_cast<int>(working_.size());
      working_.push_back(i);
    }
}

// Others that the forces found would close; true if there are any.
bool BodyContacts::grow_working() {
  std::vector<VecX> moved(domains_.size());
  for (std::size_t b = 0; b < domains_.size(); ++b)
    if (domains_[b].mobile) moved[b] = displacement(domains_[b]);
  const std::size_t before = working_.size();
  for (int i = 0; i < static_cast<int>(solved_.size()); ++i) {
    if (works_[i] >= 0) continue;
    double gap = solved_[i].delta_free[0];
    for (const Lever& l : solved_[i].lever)
      if (l.place >= 0) gap += l.weight * solved_[i].frame.col(0).dot(moved[l.body].segment<3>(3 * l.place));
    if (gap >= -closed_gap) continue;
    works_[i] = static_cast<int>(working_.size());
    working_.push_back(i);
  }
  return working_.size() > before;
}

void BodyContacts::assemble() {
  const int n = static_cast<int>(working_.size()), m = rows_per_contact_;
  W_.resize(m * n, m * n);
  for (int j = 0; j < n; ++j)
    for (int i = 0; i <= j; ++i) {
      const BodyContact &a = solved_[working_[i]], &b = solved_[working_[j]];
      const Mat3 G = between(a.lever, b.lever);
      if (m == 1) {
        W_(i, j) = W_(j, i) = a.frame.col(0).dot(G * b.frame.col(0));
      } else {
        const Mat3 block = a.frame.transpose() * G * b.frame;
        W_.block<3, 3>(3 * j, 3 * i) = block.transpose();
        W_.block<3, 3>(3 * i, 3 * j) = block;
      }
    }
}

void BodyContacts::solve_rows(const MatX& W, const VecX& q, std::span<const double> mu, VecX& lambda, int m) {
  report_.status = SolveStatus::solved;
  report_.residual = 0;
  report_.sliding = 0;
  if (mu.empty()) return;
  if (m == 1 && mu.size() <= static_cast<std::size_t>(max_rows)) {
    std::vector<std::uint8_t> active(mu.size());
    for (std::size_t i = 0; i < mu.size(); ++i) active[i] = lambda[static_cast<Eigen::Index>(i)] > 0;
    const LcpResult r = solve_lcp(W, q, lambda, active, *lcp_, 0, LcpOptions{});
    report_.status = r.status;
    report_.residual = r.residual;
    return;
  }
  CoulombOptions options;
  options.tolerance = 1e-10;
  CoulombResult r;
  r.residual = std::numeric_limits<double>::infinity();
  if (mu.size() <= static_cast<std::size_t>(max_contacts))
    r = solve_coulomb(W, q, mu, lambda, *coulomb_, 0, options);
  if (!(r.residual <= CoulombOptions{}.tolerance)) {
    options.max_sweeps = sweeps;
    r = solve_wide_coulomb(W, q, mu, lambda, options);
  }
  report_.status = r.residual <= CoulombOptions{}.tolerance ? SolveStatus::solved : r.status;
  report_.residual = r.residual;
}

// λ of the bodies' contacts, and with it the forces on their nodes.
void BodyContacts::take(const VecX& lambda, int m) {
  report_.contacts = static_cast<int>(solved_.size());
  report_.active = 0;
  for (Domain& d : domains_) d.force.setZero();
  for (std::size_t i = 0; i < solved_.size(); ++i) {
    BodyContact& c = solved_[i];
    c.lambda.setZero();
    if (works_[i] >= 0) c.lambda.head(m) = lambda.segment(m * static_cast<Eigen::Index>(works_[i]), m);
    if (!(c.lambda[0] > 0)) continue;
    ++report_.active;
    report_.sliding +=
        c.friction > 0 && c.lambda.tail<2>().norm() > inside_the_cone * c.friction * c.lambda[0];
    const Vec3 force = c.frame * c.lambda;
    for (const Lever& l : c.lever)
      if (l.place >= 0) domains_[l.body].force.segment<3>(3 * l.place) += l.weight * force;
  }
  remember();
}

void BodyContacts::set_tool(const VecX& tool_force) {
  for (Domain& d : domains_) d.tool.setZero();
  for (std::size_t i = 0; i < patch_.size(); ++i) {
    Domain& d = domains_[patch_[i].body];
    d.tool.segment<3>(3 * d.place[patch_[i].node]) = tool_force.segment<3>(3 * static_cast<Eigen::Index>(i));
  }
}

// C f for a force on few of the nodes.
VecX BodyContacts::displacement(const Domain& d) {
  VecX moved = VecX::Zero(d.force.size());
  for (Eigen::Index k = 0; k < d.force.size(); k += 3) {
    const Vec3 f = d.tool.segment<3>(k) + d.force.segment<3>(k);
    if (!f.isZero(0)) moved.noalias() += d.C.middleCols<3>(k) * f;
  }
  return moved;
}

void BodyContacts::move() {
  for (Domain& d : domains_) {
    if (!d.mobile) continue;
    const VecX moved = displacement(d);
    for (std::size_t k = 0; k < d.nodes.size(); ++k)
      d.linear[k] += relax_ * (d.free[k] + moved.segment<3>(3 * static_cast<Eigen::Index>(k)) - d.linear[k]);
  }
}

void BodyContacts::solve(const VecX& tool_force) {
  choose_working();
  set_tool(tool_force);
  for (Domain& d : domains_) d.force.setZero();
  std::vector<VecX> moved(domains_.size());
  for (std::size_t b = 0; b < domains_.size(); ++b)
    if (domains_[b].mobile) moved[b] = displacement(domains_[b]);
  const int m = rows_per_contact_;
  do {
    assemble();
    const auto n = static_cast<Eigen::Index>(working_.size());
    VecX q(m * n), lambda(m * n);
    std::vector<double> mu;
    for (Eigen::Index i = 0; i < n; ++i) {
      const BodyContact& c = solved_[working_[i]];
      Vec3 shift = Vec3::Zero();
      for (const Lever& l : c.lever)
        if (l.place >= 0) shift += l.weight * moved[l.body].segment<3>(3 * l.place);
      q.segment(m * i, m) = (c.delta_free + c.frame.transpose() * shift).head(m);
      lambda.segment(m * i, m) = c.lambda.head(m);
      mu.push_back(c.friction);
    }
    solve_rows(W_, q, mu, lambda, m);
    take(lambda, m);
  } while (grow_working());
  move();
}

VecX BodyContacts::solve_with(const CondensedProblem& problem, const ContactRows& tool, VecX& tool_lambda) {
  choose_working();
  const int mt = tool.rows_per_contact;
  std::vector<ToolRow> rows(tool.contacts);
  std::vector<int> working;
  bool known = false;
  for (int i = 0; i < tool.contacts; ++i) known = known || tool_lambda[mt * i] > 0;
  for (int i = 0; i < tool.contacts; ++i) {
    const PatchSample& s = problem.sample[tool.row[i].sample];
    for (int c = 0; c < 3 && s.node[0] >= 0; ++c) {
      const PatchNode& p = patch_[s.node[c]];
      rows[i].lever[c] = {p.body, domains_[p.body].place[p.node], s.weight[c]};
    }
    rows[i].works = known ? tool_lambda[mt * i] > 0 : tool.q()[mt * i] < 0;
    if (rows[i].works) working.push_back(i);
  }
  VecX force;
  for (bool more = true; more;) {
    force = solve_working_with(problem, tool, rows, working, tool_lambda);
    more = grow_working();
    for (int i = 0; i < tool.contacts; ++i)
      if (!rows[i].works && tool_delta_[mt * i] < -closed_gap) {
        rows[i].works = more = true;
        working.push_back(i);
      }
  }
  move();
  return force;
}

VecX BodyContacts::solve_working_with(const CondensedProblem& problem, const ContactRows& tool,
                                      std::span<const ToolRow> rows, std::span<const int> working,
                                      VecX& tool_lambda) {
  assemble();
  const auto nt = static_cast<Eigen::Index>(working.size()), nb = static_cast<Eigen::Index>(working_.size());
  const Eigen::Index n = nt + nb;
  const int mt = tool.rows_per_contact, mb = rows_per_contact_, m = std::max(mt, mb);
  MatX W = MatX::Zero(m * n, m * n);
  VecX q = VecX::Zero(m * n), lambda = VecX::Zero(m * n);
  std::vector<double> mu(n);
  for (Eigen::Index i = 0; i < nt; ++i) {
    const ContactRow& row = tool.row[working[i]];
    q.segment(m * i, mt) = tool.q().segment(mt * working[i], mt);
    lambda.segment(m * i, mt) = tool_lambda.segment(mt * working[i], mt);
    mu[i] = mt == 3 ? row.friction : 0;
    for (Eigen::Index j = 0; j < nt; ++j)
      W.block(m * i, m * j, mt, mt) = tool.W().block(mt * working[i], mt * working[j], mt, mt);
    for (Eigen::Index j = 0; j < nb; ++j) {
      const BodyContact& c = solved_[working_[j]];
      const Mat3 block = row.frame.transpose() * between(rows[working[i]].lever, c.lever) * c.frame;
      W.block(m * i, m * (nt + j), mt, mb) = block.topLeftCorner(mt, mb);
      W.block(m * (nt + j), m * i, mb, mt) = block.topLeftCorner(mt, mb).transpose();
    }
  }
  for (Eigen::Index i = 0; i < nb; ++i) {
    const BodyContact& c = solved_[working_[i]];
    q.segment(m * (nt + i), mb) = c.delta_free.head(mb);
    lambda.segment(m * (nt + i), mb) = c.lambda.head(mb);
    mu[nt + i] = c.friction;
    for (Eigen::Index j = 0; j < nb; ++j)
      W.block(m * (nt + i), m * (nt + j), mb, mb) = W_.block(mb * i, mb * j, mb, mb);
  }
  solve_rows(W, q, mu, lambda, m);

  VecX force = VecX::Zero(3 * static_cast<Eigen::Index>(patch_.size()));
  tool_lambda.setZero();
  for (Eigen::Index i = 0; i < nt; ++i) {
    const ContactRow& row = tool.row[working[i]];
    const PatchSample& s = problem.sample[row.sample];
    tool_lambda.segment(mt * working[i], mt) = lambda.segment(m * i, mt);
    const Vec3 f = row.frame.leftCols(mt) * lambda.segment(m * i, mt);
    for (int c = 0; c < 3 && s.node[0] >= 0; ++c) force.segment<3>(3 * s.node[c]) += s.weight[c] * f;
  }
  VecX bodies(mb * nb);
  for (Eigen::Index i = 0; i < nb; ++i) bodies.segment(mb * i, mb) = lambda.segment(m * (nt + i), mb);
  take(bodies, mb);

  // δ of all the instrument's rows: W has its own forces' part, the bodies' forces move the rest.
  for (Domain& d : domains_) d.tool.setZero();
  std::vector<VecX> moved(domains_.size());
  for (std::size_t b = 0; b < domains_.size(); ++b)
    if (domains_[b].mobile) moved[b] = displacement(domains_[b]);
  tool_delta_ = tool.W() * tool_lambda + tool.q();
  for (int i = 0; i < tool.contacts; ++i) {
    Vec3 shift = Vec3::Zero();
    for (const Lever& l : rows[i].lever)
      if (l.place >= 0) shift += l.weight * moved[l.body].segment<3>(3 * l.place);
    tool_delta_.segment(mt * i, mt) += (tool.row[i].frame.transpose() * shift).head(mt);
  }
  set_tool(force);
  return force;
}

void BodyContacts::remember() {
  memory_.clear();
  for (const BodyContact& c : solved_)
    if (c.lambda[0] > 0) memory_.push_back({c.pair, c.node, c.face, c.frame.col(0), c.frame * c.lambda});
}

void BodyContacts::patch_positions(PatchPositions& x) const {
  for (std::size_t i = 0; i < patch_.size(); ++i) {
    const Domain& d = domains_[patch_[i].body];
    x[i] = d.linear[d.place[patch_[i].node]];
  }
}

void BodyContacts::condense(CondensedProblem& problem) const {
  // Closed normals, sticking tangents: (contact, direction).
  std::vector<std::pair<int, int>> kept;
  for (int i = 0; i < static_cast<int>(solved_.size()); ++i) {
    const BodyContact& c = solved_[i];
    if (!(c.lambda[0] > 0)) continue;
    kept.emplace_back(i, 0);
    if (rows_per_contact_ == 1 || c.lambda.tail<2>().norm() > inside_the_cone * c.friction * c.lambda[0])
      continue;
    if (c.friction <= 0) continue;
    kept.emplace_back(i, 1);
    kept.emplace_back(i, 2);
  }
  const auto rows = static_cast<Eigen::Index>(kept.size());
  const auto nodes = static_cast<Eigen::Index>(patch_.size());
  problem.C().setZero();
  for (Eigen::Index j = 0; j < nodes; ++j)
    for (Eigen::Index i = 0; i < nodes; ++i) {
      if (patch_[i].body != patch_[j].body) continue;
      const Domain& d = domains_[patch_[i].body];
      problem.C().block<3, 3>(3 * i, 3 * j) =
          d.C.block<3, 3>(3 * d.place[patch_[i].node], 3 * d.place[patch_[j].node]);
    }

  MatX Y = MatX::Zero(rows, 3 * nodes);
  VecX f(3 * nodes), moved(3 * nodes);
  for (Eigen::Index j = 0; j < nodes; ++j) {
    const Domain& d = domains_[patch_[j].body];
    const int place = d.place[patch_[j].node];
    f.segment<3>(3 * j) = d.tool.segment<3>(3 * place);
    moved.segment<3>(3 * j) = d.C.middleRows<3>(3 * place) * d.force;
    for (Eigen::Index r = 0; r < rows; ++r) {
      const BodyContact& c = solved_[kept[r].first];
      for (const Lever& l : c.lever)
        if (l.place >= 0 && l.body == patch_[j].body)
          Y.block<1, 3>(r, 3 * j) +=
              l.weight * c.frame.col(kept[r].second).transpose() * d.C.block<3, 3>(3 * l.place, 3 * place);
    }
  }
  if (rows > 0 && nodes > 0) {
    const int m = rows_per_contact_;
    MatX M(rows, rows);
    VecX D(rows);
    for (Eigen::Index r = 0; r < rows; ++r) {
      for (Eigen::Index s = 0; s < rows; ++s)
        M(r, s) = W_(m * works_[kept[r].first] + kept[r].second, m * works_[kept[s].first] + kept[s].second);
      const int first = m * works_[kept[r].first];
      D[r] = m == 1 ? W_(first, first) : W_.block<3, 3>(first, first).trace() / 3;
    }
    Eigen::LLT<MatX> factor;
    for (double epsilon = relative_diagonal; epsilon < 1e-2; epsilon *= 100) {
      factor.compute(M + MatX((epsilon * D).asDiagonal()));
      if (factor.info() == Eigen::Success) break;
    }
    if (factor.info() == Eigen::Success) {
      factor.matrixL().solveInPlace(Y);
      problem.C().noalias() -= Y.transpose() * Y;
      const VecX Yf = Y * f;
      moved.noalias() += Y.transpose() * Yf;
    }
  }
  for (Eigen::Index j = 0; j < nodes; ++j) {
    const Domain& d = domains_[patch_[j].body];
    problem.x_free[j] = d.free[d.place[patch_[j].node]] + moved.segment<3>(3 * j);
  }
}

void BodyContacts::add_forces(int body, Eigen::Ref<VecX> f) const {
  const Domain& d = domains_[body];
  for (std::size_t k = 0; k < d.nodes.size(); ++k)
    f.segment<3>(3 * d.nodes[k]) += d.force.segment<3>(3 * static_cast<Eigen::Index>(k));
}

Vec3 BodyContacts::force_on(int body) const {
  Vec3 sum = Vec3::Zero();
  for (const BodyContact& c : applied_)
    for (const Lever& l : c.lever)
      if (l.body == body) sum += l.weight * (c.frame * c.lambda);
  return sum;
}

int BodyContacts::join_missed(const Bodies& bodies, const Positions& x_end) {
  std::vector<Encounter> found;
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
    finder_.find(bodies, k, x_end, margin, depth, moved, base_margin * depth, found);
  }
  int joined = 0;
  // A node that slid past the faces it was to meet: those it came to join.
  std::erase_if(found, [&](Encounter& e) {
    const auto known = std::find_if(encounters_.begin(), encounters_.end(), [&](const Encounter& other) {
      return other.pair == e.pair && other.node == e.node;
    });
    if (known == encounters_.end()) return false;
    std::vector<int> both;
    std::set_union(known->faces.begin(), known->faces.end(), e.faces.begin(), e.faces.end(),
                   std::back_inserter(both));
    joined += both.size() > known->faces.size();
    known->faces = std::move(both);
    return true;
  });
  if (found.empty() && joined == 0) return 0;
  const auto capacity = static_cast<std::size_t>(max_body_contacts);
  if (encounters_.size() + found.size() > capacity)
    std::erase_if(encounters_, [&](const Encounter& e) {
      return std::none_of(solved_.begin(), solved_.end(), [&](const BodyContact& c) {
        return c.pair == e.pair && c.node == e.node && c.lambda[0] > 0;
      });
    });
  std::sort(found.begin(), found.end(), [](const Encounter& a, const Encounter& b) { return a.gap < b.gap; });
  const std::size_t room = capacity - std::min(capacity, encounters_.size());
  if (found.size() > room) found.resize(room);
  for (Encounter& e : found) {
    e.margin = base_margin * depth_of(bodies, pairs()[e.pair]);
    encounters_.push_back(std::move(e));
  }
  joined += static_cast<int>(found.size());
  if (joined == 0) return 0;
  const BodyContactReport before = report_;
  index_contact_nodes(bodies);
  report_.joined = before.joined + joined;
  return joined;
}

}  // namespace hapticd
