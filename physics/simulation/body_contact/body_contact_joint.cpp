// body_contact.h: the solve of bodies and instrument together.
#include "physics/simulation/body_contact/body_contact.h"
#include "physics/simulation/body_contact/frictionless_elimination.h"

namespace hapticd {
namespace {

// Of all the instrument's rows, those of these contacts.
VecX taken(const VecX& all, std::span<const int> contacts, int m) {
  VecX out(m * static_cast<Eigen::Index>(contacts.size()));
  for (std::size_t i = 0; i < contacts.size(); ++i)
    out.segment(m * static_cast<Eigen::Index>(i), m) = all.segment(m * contacts[i], m);
  return out;
}

void put_back(const VecX& some, std::span<const int> contacts, int m, VecX& all) {
  all.setZero();
  for (std::size_t i = 0; i < contacts.size(); ++i)
    all.segment(m * contacts[i], m) = some.segment(m * static_cast<Eigen::Index>(i), m);
}

struct Friction {
  std::vector<double> mu, limit;  // limit: empty without edges

  Friction(const ContactRows& tool, std::span<const int> contacts) {
    for (const int i : contacts) {
      mu.push_back(tool.rows_per_contact == 3 ? tool.row[i].friction : 0);
      if (tool.edges > 0) limit.push_back(tool.row[i].limit);
    }
  }
};

}  // namespace

VecX BodyContacts::solve_with(const CondensedProblem& problem, const ContactRows& tool, VecX& tool_lambda) {
  choose_working();
  const int mt = tool.rows_per_contact;
  std::vector<ToolRow> rows(tool.contacts);
  std::vector<int> working;
  bool known = false;
  const auto bears = [&](int i) { return !tool_lambda.segment(mt * i, mt).isZero(0); };
  for (int i = 0; i < tool.contacts; ++i) known = known || bears(i);
  for (int i = 0; i < tool.contacts; ++i) {
    const NodeWeights at = node_weights(problem, tool.row[i]);
    for (std::size_t c = 0; c < at.node.size(); ++c) {
      const PatchNode& p = patch_[at.node[c]];
      rows[i].stencil[c] = {p.body, domains_[p.body].place[p.node], at.weight[c]};
    }
    rows[i].frame = tool.row[i].frame;
    rows[i].works = known ? bears(i) : tool.q()[mt * i] < 0;
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
  assemble(rows);
  const auto nt = static_cast<Eigen::Index>(working.size()), nb = static_cast<Eigen::Index>(working_.size());
  const int mt = tool.rows_per_contact, mb = rows_per_contact_;
  VecX bodies(mb * nb);
  for (Eigen::Index i = 0; i < nb; ++i) bodies.segment(mb * i, mb) = solved_[working_[i]].lambda.head(mb);
  if (friction_held_ || mt != 3 || mb != 1 || !solve_eliminating(tool, working, tool_lambda, bodies))
    solve_as_one(tool, working, tool_lambda, bodies);
  take(bodies, mb);

  VecX force = VecX::Zero(3 * static_cast<Eigen::Index>(patch_.size()));
  for (Eigen::Index i = 0; i < nt; ++i) {
    const ContactRow& row = tool.row[working[i]];
    const NodeWeights at = node_weights(problem, row);
    const Vec3 f = row.frame.leftCols(mt) * tool_lambda.segment(mt * working[i], mt);
    for (std::size_t c = 0; c < at.node.size(); ++c) force.segment<3>(3 * at.node[c]) += at.weight[c] * f;
  }
  const VecX shift = W_tool_ * bodies;
  tool_delta_ = tool.W() * tool_lambda + tool.q();
  for (int i = 0; i < tool.contacts; ++i) tool_delta_.segment(mt * i, mt) += shift.segment(3 * i, mt);
  set_tool(force);
  return force;
}

bool BodyContacts::solve_eliminating(const ContactRows& tool, std::span<const int> working, VecX& tool_lambda,
                                     VecX& lambda) {
  const auto nt = static_cast<Eigen::Index>(working.size()), nb = lambda.size();
  MatX W_tt(3 * nt, 3 * nt), W_tb(3 * nt, nb);
  for (Eigen::Index i = 0; i < nt; ++i) {
    W_tb.middleRows<3>(3 * i) = W_tool_.middleRows<3>(3 * working[i]);
    for (Eigen::Index j = 0; j < nt; ++j)
      W_tt.block<3, 3>(3 * i, 3 * j) = tool.W().block<3, 3>(3 * working[i], 3 * working[j]);
  }
  VecX q_b(nb), lambda_t = taken(tool_lambda, working, 3);
  for (Eigen::Index i = 0; i < nb; ++i) q_b[i] = solved_[working_[i]].delta_free[0];
  const Friction friction(tool, working);
  if (nt > coulomb_->capacity) coulomb_ = std::make_unique<CoulombWorkspace>(2 * static_cast<int>(nt), false);
  if (nb > lcp_->capacity) lcp_ = std::make_unique<LcpWorkspace>(2 * static_cast<int>(nb));
  const EliminationResult r =
      solve_eliminated(W_, q_b, lambda, W_tb, W_tt, taken(tool.q(), working, 3), friction.mu, friction.limit,
                       lambda_t, *lcp_, *coulomb_, options_of_coulomb());
  if (!r.solved) return false;
  report_.status = SolveStatus::solved;
  report_.residual = r.residual;
  report_.sliding = 0;
  put_back(lambda_t, working, 3, tool_lambda);
  return true;
}

void BodyContacts::solve_as_one(const ContactRows& tool, std::span<const int> working, VecX& tool_lambda,
                                VecX& bodies) {
  const auto nt = static_cast<Eigen::Index>(working.size()), nb = static_cast<Eigen::Index>(working_.size());
  const Eigen::Index n = nt + nb;
  const int mt = tool.rows_per_contact, mb = rows_per_contact_, m = std::max(mt, mb);
  MatX W = MatX::Zero(m * n, m * n);
  VecX q = VecX::Zero(m * n), lambda = VecX::Zero(m * n);
  Friction friction(tool, working);
  for (Eigen::Index i = 0; i < nt; ++i) {
    q.segment(m * i, mt) = tool.q().segment(mt * working[i], mt);
    lambda.segment(m * i, mt) = tool_lambda.segment(mt * working[i], mt);
    for (Eigen::Index j = 0; j < nt; ++j)
      W.block(m * i, m * j, mt, mt) = tool.W().block(mt * working[i], mt * working[j], mt, mt);
    for (Eigen::Index j = 0; j < nb; ++j) {
      const auto block = W_tool_.block(3 * working[i], mb * j, mt, mb);
      W.block(m * i, m * (nt + j), mt, mb) = block;
      W.block(m * (nt + j), m * i, mb, mt) = block.transpose();
    }
  }
  for (Eigen::Index i = 0; i < nb; ++i) {
    const BodyContact& c = solved_[working_[i]];
    q.segment(m * (nt + i), mb) = c.delta_free.head(mb);
    lambda.segment(m * (nt + i), mb) = bodies.segment(mb * i, mb);
    friction.mu.push_back(c.friction);
    for (Eigen::Index j = 0; j < nb; ++j)
      W.block(m * (nt + i), m * (nt + j), mb, mb) = W_.block(mb * i, mb * j, mb, mb);
  }
  if (!friction.limit.empty()) friction.limit.resize(n, no_limit);
  solve_rows(W, q, friction.mu, friction.limit, lambda, m);
  tool_lambda.setZero();
  for (Eigen::Index i = 0; i < nt; ++i) tool_lambda.segment(mt * working[i], mt) = lambda.segment(m * i, mt);
  for (Eigen::Index i = 0; i < nb; ++i) bodies.segment(mb * i, mb) = lambda.segment(m * (nt + i), mb);
}

}  // namespace hapticd
