// body_contact.h: the solve of the bodies alone, and what both solves share.
//
// Of some two hundred contacts within reach a dozen close. Solved are those that carried force (if none:
// those that free motion closes); then every other is looked at under the forces found, and those that
// overlap by a nanometre join, until none does: the same solution for a small part of the work.
#include <algorithm>
#include <cmath>

#include "physics/simulation/body_contact/body_contact.h"

namespace hapticd {
// The raised diagonal is a hundredth of the haptic loop's: a loose piece yields some two hundred times as far
// as its tissue, and eight rounds, which take ε off again, left bearing contacts up to 90 nm open or closed.
CoulombOptions BodyContacts::options_of_coulomb() {
  CoulombOptions options;
  options.tolerance = 1e-10;
  options.raised_diagonal = 1e-6;
  return options;
}

// The rows to begin with: those that carried force; where none did, those that the free motion closes.
void BodyContacts::choose_working() {
  solved_ = rows_;
  working_.clear();
  W_.resize(0, 0);
  W_tool_.resize(0, 0);
  works_.assign(solved_.size(), -1);
  const bool known =
      std::any_of(solved_.begin(), solved_.end(), [](const auto& c) { return !c.lambda.isZero(0); });
  for (int i = 0; i < static_cast<int>(solved_.size()); ++i)
    if (known ? !solved_[i].lambda.isZero(0) : solved_[i].delta_free[0] < 0) {
      works_[i] = static_cast<int>(working_.size());
      working_.push_back(i);
    }
}

// Others that the forces found would close; true if there are any.
bool BodyContacts::grow_working() {
  find_moved();
  const std::size_t before = working_.size();
  for (int i = 0; i < static_cast<int>(solved_.size()); ++i) {
    if (works_[i] >= 0) continue;
    double gap = solved_[i].delta_free[0];
    for (const ContactStencil& l : solved_[i].stencil)
      if (l.place >= 0) gap += l.weight * solved_[i].frame.col(0).dot(moved_[l.body].segment<3>(3 * l.place));
    if (gap >= -closed_gap) continue;
    works_[i] = static_cast<int>(working_.size());
    working_.push_back(i);
  }
  return working_.size() > before;
}

// W of the working contacts, and of the instrument's rows with them; of those that were there before, it
// stands already. A column is gathered from what its contact's unit force does to the domains.
void BodyContacts::assemble(std::span<const ToolRow> tool) {
  const int n = static_cast<int>(working_.size()), m = rows_per_contact_;
  const int known = static_cast<int>(W_.rows()) / m;
  W_.conservativeResize(m * n, m * n);
  W_tool_.conservativeResize(3 * static_cast<Eigen::Index>(tool.size()), m * n);
  if (m == 1)
    assemble_rows<1>(tool, known);
  else
    assemble_rows<3>(tool, known);
}

template <int m>
void BodyContacts::assemble_rows(std::span<const ToolRow> tool, int known) {
  using Columns = Eigen::Matrix<double, Eigen::Dynamic, m>;
  using Block = Eigen::Matrix<double, 3, m>;
  std::vector<Columns> moved(domains_.size());
  const auto gathered = [&](std::span<const ContactStencil> stencil, int first, int second) {
    Block sum = Block::Zero();
    for (const ContactStencil& l : stencil)
      if (l.place >= 0 && (l.body == first || l.body == second))
        sum += l.weight * moved[l.body].template middleRows<3>(3 * l.place);
    return sum;
  };
  for (int j = known; j < static_cast<int>(working_.size()); ++j) {
    const BodyContact& c = solved_[working_[j]];
    const int first = c.stencil[0].body, second = c.stencil[1].body;
    for (const int b : {first, second})
      if (domains_[b].mobile) moved[b].setZero(domains_[b].C.rows(), m);
    for (const ContactStencil& l : c.stencil) {
      if (l.place < 0) continue;
      const MatX& C = domains_[l.body].C;
      for (int k = 0; k < m; ++k) {
        const Vec3 f = l.weight * c.frame.col(k);
        moved[l.body].col(k) +=
            f[0] * C.col(3 * l.place) + f[1] * C.col(3 * l.place + 1) + f[2] * C.col(3 * l.place + 2);
      }
    }
    for (int i = 0; i <= j; ++i) {
      const BodyContact& a = solved_[working_[i]];
      const Eigen::Matrix<double, m, m> block =
          a.frame.template leftCols<m>().transpose() * gathered(a.stencil, first, second);
      W_.block<m, m>(m * j, m * i) = block.transpose();
      W_.block<m, m>(m * i, m * j) = block;
    }
    for (std::size_t r = 0; r < tool.size(); ++r)
      W_tool_.block<3, m>(3 * static_cast<Eigen::Index>(r), m * j) =
          tool[r].frame.transpose() * gathered(tool[r].stencil, first, second);
  }
}

void BodyContacts::solve_rows(const MatX& W, const VecX& q, std::span<const double> mu,
                              std::span<const double> limit, VecX& lambda, int m) {
  report_.status = SolveStatus::solved;
  report_.residual = 0;
  report_.sliding = 0;
  if (mu.empty()) return;
  if (m == 1 || friction_held_) return solve_normals(W, q, limit, lambda, m);
  const auto contacts = static_cast<int>(mu.size());
  if (contacts > coulomb_->capacity) coulomb_ = std::make_unique<CoulombWorkspace>(2 * contacts, false);
  const CoulombResult r = solve_coulomb(W, q, mu, lambda, *coulomb_, 0, options_of_coulomb(), limit);
  // Of W itself: what is solved with a raised diagonal may be far from solved.
  report_.residual = coulomb_residual(W, q, lambda, mu, limit);
  if (!(report_.residual <= CoulombOptions{}.tolerance))
    report_.status = r.status == SolveStatus::solved ? SolveStatus::iteration_cap : r.status;
}

// The normal forces, all else of λ given: an LCP of A = W_nn, b = q_n + W_n,given λ_given.
void BodyContacts::solve_normals(const MatX& W, const VecX& q, std::span<const double> limit, VecX& lambda,
                                 int m) {
  std::vector<Eigen::Index> normal;
  for (Eigen::Index i = 0; m * i < q.size(); ++i)
    if (limit.empty() || limit[i] == no_limit) normal.push_back(m * i);
  VecX given = lambda, found = lambda(normal);
  given(normal).setZero();
  const VecX b = (q + W * given)(normal);
  const auto contacts = static_cast<int>(normal.size());
  if (contacts > lcp_->capacity) lcp_ = std::make_unique<LcpWorkspace>(2 * contacts);
  std::vector<std::uint8_t> active(normal.size());
  for (int i = 0; i < contacts; ++i) active[i] = found[i] > 0;
  const LcpResult r = solve_lcp(W(normal, normal), b, found, active, *lcp_, 0, LcpOptions{});
  report_.status = r.status;
  report_.residual = r.residual;
  lambda(normal) = found;
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
    if (c.lambda.isZero(0)) continue;
    report_.active += c.lambda[0] > 0;
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

void BodyContacts::find_moved() {
  moved_.resize(domains_.size());
  for (std::size_t b = 0; b < domains_.size(); ++b)
    if (domains_[b].mobile) moved_[b] = displacement(domains_[b]);
}

// To where the forces of the last `find_moved` take the domains.
void BodyContacts::move() {
  for (std::size_t b = 0; b < domains_.size(); ++b) {
    Domain& d = domains_[b];
    if (!d.mobile) continue;
    std::vector<Vec3> to = d.free;
    for (std::size_t k = 0; k < to.size(); ++k)
      to[k] += moved_[b].segment<3>(3 * static_cast<Eigen::Index>(k));
    last_way_ = std::max(last_way_, travel(d, to));
  }
}

void BodyContacts::solve(const VecX& tool_force) {
  choose_working();
  set_tool(tool_force);
  for (Domain& d : domains_) d.force.setZero();
  find_moved();
  const std::vector<VecX> moved = moved_;
  const int m = rows_per_contact_;
  do {
    assemble({});
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
