// An instrument held between two walls that face one another, on many points: the forces inside are large and
// not unique, the wrench is. A raised diagonal that helps to find them must not change it.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <memory>

#include "physics/contact/solver/coulomb.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

struct Wedge {
  MatX J;  // rows × 6
  MatX W;
  VecX q;
  std::vector<double> mu;
};

// `per_side` points on each of two walls that open by `angle`; a coupling of 400 N/m, walls a thousand times
// as stiff; pushed in by up to a millimetre.
Wedge wedge(Random& random, int per_side, double angle) {
  constexpr double coupling = 400, rotational = 0.04, size = 4e-3, wall = 1e-3;
  Wedge w;
  const int n = 2 * per_side;
  w.J.resize(3 * n, 6);
  w.q.resize(3 * n);
  const Vec3 push(uniform(random, -3e-4, 3e-4), uniform(random, -3e-4, 3e-4), uniform(random, -1e-3, -2e-4));
  for (int i = 0; i < n; ++i) {
    const double side = i < per_side ? 1 : -1;
    const Vec3 normal(side * std::cos(angle / 2), 0, std::sin(angle / 2)), t1 = Vec3::UnitY(),
                                                                           t2 = normal.cross(t1);
    const Vec3 at(-side * size / 4, uniform(random, -size, size) / 2, uniform(random, -size, size) / 2);
    const Vec3 axes[] = {normal, t1, t2};
    for (int k = 0; k < 3; ++k) {
      w.J.row(3 * i + k) << axes[k].transpose(), at.cross(axes[k]).transpose();
      w.q[3 * i + k] = axes[k].dot(push);
    }
    w.q[3 * i] -= 2e-5;
    w.mu.push_back(uniform(random, 0.2, 0.8));
  }
  Vec6 compliance;
  compliance << Vec3::Constant(1 / coupling), Vec3::Constant(1 / rotational);
  w.W = w.J * compliance.asDiagonal() * w.J.transpose();
  w.W.diagonal().array() += wall / coupling;
  return w;
}

TEST(Wedge, ItsWrenchIsThatOfTheProblemAsItStands) {
  Random random(31);
  const auto workspace = std::make_unique<CoulombWorkspace>();
  int raised = 0, compared = 0;
  double worst = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const Wedge w = wedge(random, 2 + trial % 10, uniform(random, 0.05, 1));
    CoulombOptions options;
    if (trial % 2 == 0) workspace->raised = 1;  // as behind a stall
    VecX lambda = VecX::Zero(w.q.size()), reference = lambda;
    const CoulombResult a = solve_coulomb(w.W, w.q, w.mu, lambda, *workspace, 0, options);
    const auto anew = std::make_unique<CoulombWorkspace>();
    const CoulombResult b = solve_coulomb(w.W, w.q, w.mu, reference, *anew, 0, options);
    raised += a.rounds > 0 || a.relative_diagonal > options.relative_diagonal;
    if (a.status != SolveStatus::solved || b.status != SolveStatus::solved ||
        b.relative_diagonal > options.relative_diagonal)
      continue;
    // The reference solves the problem as it stands, which its residual says by itself.
    ASSERT_LT(coulomb_residual(w.W, w.q, reference, w.mu), 1e-6);
    ++compared;
    const Vec3 f = w.J.leftCols(3).transpose() * lambda, g = w.J.leftCols(3).transpose() * reference;
    worst = std::max(worst, (f - g).norm() / g.norm());
  }
  EXPECT_GT(raised, 60);
  EXPECT_GT(compared, 100);
  EXPECT_LT(worst, 1e-4);
}

// Natural map of W λ + q + ε D (λ − anchor), by nothing that the solver kept but the anchor.
double residual_about(const Wedge& w, const VecX& lambda, double epsilon, const std::vector<double>& anchor) {
  MatX W = w.W;
  VecX q = w.q;
  for (Eigen::Index i = 0; i < W.rows(); i += 3) {
    const double added = epsilon * w.W.diagonal().segment<3>(i).mean();
    W.diagonal().segment<3>(i).array() += added;
    q.segment<3>(i) -= added * VecX::Map(anchor.data(), q.size()).segment<3>(i);
  }
  return coulomb_residual(W, q, lambda, w.mu);
}

// Few steps, so that rounds that take the raised diagonal off end unsolved: what is put back then is an
// answer with the residual, the diagonal and the anchor that belong to it.
TEST(Wedge, OfARaisedDiagonalTheAnswerIsWhatItSays) {
  Random random(32);
  const auto workspace = std::make_unique<CoulombWorkspace>();
  int as_it_stands = 0, about_an_anchor = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    const Wedge w = wedge(random, 2 + trial % 10, uniform(random, 0.05, 1));
    CoulombOptions options;
    options.tolerance = trial % 2 ? 1e-6 : 1e-9;
    options.max_newton = 3 + trial % 13;
    options.max_sweeps = 6 + trial % 20;
    workspace->raised = 1;
    VecX lambda = VecX::Zero(w.q.size());
    const CoulombResult r = solve_coulomb(w.W, w.q, w.mu, lambda, *workspace, 0, options);
    if (r.status != SolveStatus::solved) continue;
    (r.relative_diagonal == 0 ? as_it_stands : about_an_anchor)++;
    const double truly = residual_about(w, lambda, r.relative_diagonal, workspace->anchor);
    EXPECT_LE(truly, 1.5 * options.tolerance) << trial;
    EXPECT_NEAR(truly, r.residual, 0.5 * truly + 1e-11) << trial;
  }
  EXPECT_GT(as_it_stands, 100);
  EXPECT_GT(about_an_anchor, 20);
}

// Of what has been taken off, nothing is reported: the problem is solved as it stands.
TEST(Wedge, ADiagonalThatWasTakenOffIsNotReported) {
  Random random(33);
  const auto workspace = std::make_unique<CoulombWorkspace>();
  int solved = 0;
  for (int trial = 0; trial < 100; ++trial) {
    const Wedge w = wedge(random, 2 + trial % 6, uniform(random, 0.3, 1));
    workspace->raised = 1;
    VecX lambda = VecX::Zero(w.q.size());
    const CoulombOptions options;
    const CoulombResult r = solve_coulomb(w.W, w.q, w.mu, lambda, *workspace, 0, options);
    if (r.status != SolveStatus::solved || coulomb_residual(w.W, w.q, lambda, w.mu) > options.tolerance)
      continue;
    ++solved;
    EXPECT_EQ(r.relative_diagonal, 0) << trial;
  }
  EXPECT_GT(solved, 80);
}

}  // namespace
}  // namespace hapticd
