// body_contact.h: the solve, of the bodies alone and together with the instrument.
//
// Of some two hundred contacts within reach a dozen close. Solved are those that carried force (if none:
// those that free motion closes); then every other is looked at under the forces found, and those that
// overlap by a nanometre join, until none does: the same solution for a small part of the work.
#include <algorithm>
#include <cmath>

#include "physics/simulation/body_contact/body_contact.h"

namespace hapticd {
namespace {

constexpr double closed_gap = 1e-9;  // overlap that makes a contact part of the solve [m]
constexpr int most_sweeps = 2000;    // no deadline of a millisecond here

}  // namespace

Mat3 BodyContacts::between(std::span<const ContactStencil> a, std::span<const ContactStencil> b) const {
  Mat3 G = Mat3::Zero();
  for (const ContactStencil& s : a) {
    if (s.place < 0) continue;
    for (const ContactStencil& t : b)
      if (t.place >= 0 && s.body == t.body)
        G += s.weight * t.weight * domains_[s.body].C.block<3, 3>(3 * s.place, 3 * t.place);
  }
  return G;
}

// The rows to begin with: those that carried force; where none did, those that the free motion closes.
void BodyContacts::choose_working() {
  solved_ = rows_;
  working_.clear();
  W_.resize(0, 0);
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
    for (const ContactStencil& l : solved_[i].stencil)
      if (l.place >= 0) gap += l.weight * solved_[i].frame.col(0).dot(moved[l.body].segment<3>(3 * l.place));
    if (gap >= -closed_gap) continue;
    works_[i] = static_cast<int>(working_.size());
    working_.push_back(i);
  }
  return working_.size() > before;
}

// W of the working contacts; of those that were there before, it stands already.
void BodyContacts::assemble() {
  const int n = static_cast<int>(working_.size()), m = rows_per_contact_;
  const int known = static_cast<int>(W_.rows()) / m;
  W_.conservativeResize(m * n, m * n);
  for (int j = known; j < n; ++j)
    for (int i = 0; i <= j; ++i) {
      const BodyContact &a = solved_[working_[i]], &b = solved_[working_[j]];
      const Mat3 G = between(a.stencil, b.stencil);
      if (m == 1) {
        W_(i, j) = W_(j, i) = a.frame.col(0).dot(G * b.frame.col(0));
      } else {
        const Mat3 block = a.frame.transpose() * G * b.frame;
        W_.block<3, 3>(3 * j, 3 * i) = block.transpose();
        W_.block<3, 3>(3 * i, 3 * j) = block;
      }
    }
}

void BodyContacts::solve_rows(const MatX& W, const VecX& q, std::span<const double> mu,
                              std::span<const double> limit, VecX& lambda, int m) {
  report_.status = SolveStatus::solved;
  report_.residual = 0;
  report_.sliding = 0;
  if (mu.empty()) return;
  const auto contacts = static_cast<int>(mu.size());
  if (m == 1) {
    if (contacts > lcp_->capacity) lcp_ = std::make_unique<LcpWorkspace>(2 * contacts);
    std::vector<std::uint8_t> active(mu.size());
    for (std::size_t i = 0; i < mu.size(); ++i) active[i] = lambda[static_cast<Eigen::Index>(i)] > 0;
    const LcpResult r = solve_lcp(W, q, lambda, active, *lcp_, 0, LcpOptions{});
    report_.status = r.status;
    report_.residual = r.residual;
    return;
  }
  if (contacts > coulomb_->capacity) coulomb_ = std::make_unique<CoulombWorkspace>(2 * contacts);
  CoulombOptions options;
  options.tolerance = 1e-10;
  CoulombResult r = solve_coulomb(W, q, mu, lambda, *coulomb_, 0, options, limit);
  if (!(r.residual <= CoulombOptions{}.tolerance)) {
    options.max_sweeps = most_sweeps;
    r = solve_coulomb(W, q, mu, lambda, *coulomb_, 0, options, limit);
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
    for (const ContactStencil& l : c.stencil)
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
      d.linear[k] = d.free[k] + moved.segment<3>(3 * static_cast<Eigen::Index>(k));
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
      for (const ContactStencil& l : c.stencil)
        if (l.place >= 0) shift += l.weight * moved[l.body].segment<3>(3 * l.place);
      q.segment(m * i, m) = (c.delta_free + c.frame.transpose() * shift).head(m);
      lambda.segment(m * i, m) = c.lambda.head(m);
      mu.push_back(c.friction);
    }
    solve_rows(W_, q, mu, {}, lambda, m);
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
    const NodeWeights at = node_weights(problem, tool.row[i]);
    for (std::size_t c = 0; c < at.node.size(); ++c) {
      const PatchNode& p = patch_[at.node[c]];
      rows[i].stencil[c] = {p.body, domains_[p.body].place[p.node], at.weight[c]};
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
  std::vector<double> mu(n), limit(tool.edges > 0 ? n : 0, no_limit);
  for (Eigen::Index i = 0; i < nt; ++i) {
    const ContactRow& row = tool.row[working[i]];
    q.segment(m * i, mt) = tool.q().segment(mt * working[i], mt);
    lambda.segment(m * i, mt) = tool_lambda.segment(mt * working[i], mt);
    mu[i] = mt == 3 ? row.friction : 0;
    if (!limit.empty()) limit[i] = row.limit;
    for (Eigen::Index j = 0; j < nt; ++j)
      W.block(m * i, m * j, mt, mt) = tool.W().block(mt * working[i], mt * working[j], mt, mt);
    for (Eigen::Index j = 0; j < nb; ++j) {
      const BodyContact& c = solved_[working_[j]];
      const Mat3 block = row.frame.transpose() * between(rows[working[i]].stencil, c.stencil) * c.frame;
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
  solve_rows(W, q, mu, limit, lambda, m);

  VecX force = VecX::Zero(3 * static_cast<Eigen::Index>(patch_.size()));
  tool_lambda.setZero();
  for (Eigen::Index i = 0; i < nt; ++i) {
    const ContactRow& row = tool.row[working[i]];
    const NodeWeights at = node_weights(problem, row);
    tool_lambda.segment(mt * working[i], mt) = lambda.segment(m * i, mt);
    const Vec3 f = row.frame.leftCols(mt) * lambda.segment(m * i, mt);
    for (std::size_t c = 0; c < at.node.size(); ++c) force.segment<3>(3 * at.node[c]) += at.weight[c] * f;
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
    for (const ContactStencil& l : rows[i].stencil)
      if (l.place >= 0) shift += l.weight * moved[l.body].segment<3>(3 * l.place);
    tool_delta_.segment(mt * i, mt) += (tool.row[i].frame.transpose() * shift).head(mt);
  }
  set_tool(force);
  return force;
}

bool BodyContacts::pushes(int body) const { return !domains_[body].force.isZero(0); }

void BodyContacts::add_forces(int body, Eigen::Ref<VecX> f) const {
  const Domain& d = domains_[body];
  for (std::size_t k = 0; k < d.nodes.size(); ++k)
    f.segment<3>(3 * d.nodes[k]) += d.force.segment<3>(3 * static_cast<Eigen::Index>(k));
}

Vec3 BodyContacts::force_on(int body) const {
  Vec3 sum = Vec3::Zero();
  for (const BodyContact& c : applied_)
    for (const ContactStencil& l : c.stencil)
      if (l.body == body) sum += l.weight * (c.frame * c.lambda);
  return sum;
}

}  // namespace hapticd
