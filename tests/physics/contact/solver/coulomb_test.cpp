#include "physics/contact/solver/coulomb.h"

#include <gtest/gtest.h>

#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

struct Solved {
  CoulombResult result;
  VecX lambda;
};

Solved solve(const MatX& W, const VecX& q, const std::vector<double>& mu,
             const CoulombOptions& options = {}) {
  static const auto workspace = std::make_unique<CoulombWorkspace>();
  Solved s;
  s.lambda = VecX::Zero(q.size());
  s.result = solve_coulomb(W, q, mu, s.lambda, *workspace, 0, options);
  return s;
}

// The conditions themselves, relative: Signorini, the cone, and friction against slip.
void expect_coulomb(const Vec3& l, const Vec3& d, double mu, double compliance, double scale,
                    double tolerance) {
  const double force = tolerance * scale, length = tolerance * scale * compliance;
  EXPECT_GE(l[0], -force);
  EXPECT_GE(d[0], -length);
  EXPECT_LE(std::min(l[0], d[0] / compliance), force);
  const double t = l.tail<2>().norm(), slip = d.tail<2>().norm();
  EXPECT_LE(t, mu * l[0] + force);
  if (slip > length && l[0] > force) {
    EXPECT_NEAR(t, mu * l[0], force + 1e-6 * t);
    if (mu > 0) {
      const double turned = (d.tail<2>() / slip + l.tail<2>() / t).norm();
      EXPECT_LE(turned * t, 10 * force * (1 + scale * compliance / slip));
    }
  }
}

TEST(CoulombContact, ConditionsHoldInThousandsOfRandomCases) {
  Random random(1);
  int open = 0, stick = 0, slip = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const Mat3 A = random_psd(random, 3, 3) + 1e-3 * Mat3::Identity();
    const Vec3 b(normal(random) - 0.8, 0.7 * normal(random), 0.7 * normal(random));
    const double mu = trial % 10 == 0 ? 0 : uniform(random, 0.01, 1.0);
    const Vec3 l = solve_coulomb_contact(A, b, mu);
    const Vec3 d = A * l + b;
    const double compliance = A.trace() / 3;
    // One contact may lever itself: A_nt large against A_nn. Its force can be large, errors scale with it.
    const double scale = l.norm() + b.norm() / compliance;
    expect_coulomb(l, d, mu, compliance, scale, 1e-11);
    if (l.isZero(0))
      ++open;
    else if (d.tail<2>().norm() < 1e-10 * scale * compliance)
      ++stick;
    else
      ++slip;
  }
  EXPECT_GT(open, 2000);
  EXPECT_GT(stick, 1500);
  EXPECT_GT(slip, 2000);
}

// A block on an incline: weight N against the plane, N tan θ down it. The free gap of a contact with
// isotropic compliance c under that load is −c·load.
TEST(CoulombContact, InclineSticksBelowTheFrictionAngleAndSlidesAbove) {
  const double c = 1e-3, N = 2.0, mu = 0.4;
  for (double degrees = 1; degrees < 60; degrees += 1) {
    const double pull = N * std::tan(degrees * M_PI / 180);
    const Vec3 l = solve_coulomb_contact(c * Mat3::Identity(), -c * Vec3(N, pull, 0), mu);
    const Vec3 slip = c * l - c * Vec3(N, pull, 0);
    EXPECT_NEAR(l[0], N, 1e-12);
    if (degrees * M_PI / 180 < std::atan(mu)) {
      EXPECT_NEAR(l[1], pull, 1e-12);
      EXPECT_NEAR(slip.norm(), 0, 1e-15);
    } else {
      EXPECT_NEAR(l[1], mu * N, 1e-12);
      EXPECT_NEAR(slip[1], -c * (pull - mu * N), 1e-15);
    }
  }
}

TEST(ProjectOnCone, IsTheNearestPointOfTheCone) {
  Random random(2);
  for (int trial = 0; trial < 2000; ++trial) {
    const double mu = trial % 7 == 0 ? 0 : uniform(random, 0, 2);
    const Vec3 v(normal(random), normal(random), normal(random));
    const Vec3 p = project_on_cone(v, mu);
    EXPECT_LE(p.tail<2>().norm(), mu * p[0] + 1e-14);
    // Variational inequality: (v − p)·(y − p) ≤ 0 for every y of the cone.
    EXPECT_NEAR((v - p).dot(p), 0, 1e-13);
    const double angle = uniform(random, 0, 2 * M_PI);
    EXPECT_LE((v - p).dot(Vec3(1, mu * std::cos(angle), mu * std::sin(angle))), 1e-13);
  }
}

// Contact-like: rows of a soft sheet (decaying with distance) plus a coupling of rank 6.
MatX tissue_like(Random& random, int contacts, double coupling) {
  MatX W = MatX::Zero(3 * contacts, 3 * contacts), J(3 * contacts, 6);
  std::vector<Vec3> place;
  std::vector<Mat3> frame;
  for (int i = 0; i < contacts; ++i) {
    place.push_back(Vec3(uniform(random, -1, 1), uniform(random, -1, 1), 0));
    frame.push_back(Quat(Eigen::AngleAxisd(uniform(random, 0, 0.8), unit_vector(random))).toRotationMatrix());
  }
  for (int i = 0; i < contacts; ++i) {
    Mat3 cross;
    cross << 0, -place[i].z(), place[i].y(), place[i].z(), 0, -place[i].x(), -place[i].y(), place[i].x(), 0;
    J.middleRows<3>(3 * i) << frame[i].transpose(), -frame[i].transpose() * cross;
    for (int j = 0; j < contacts; ++j)
      W.block<3, 3>(3 * i, 3 * j) =
          std::exp(-2 * (place[i] - place[j]).norm()) * frame[i].transpose() * frame[j];
  }
  return W + coupling * J * J.transpose();
}

TEST(Coulomb, RandomTissueContactsSatisfyTheConditions) {
  Random random(3);
  int sliding = 0, sticking = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const int contacts = 1 + trial % 30;
    const MatX W = tissue_like(random, contacts, 0.1);
    VecX q(3 * contacts);
    for (int i = 0; i < contacts; ++i)
      q.segment<3>(3 * i) = Vec3(normal(random) - 1.0, 0.5 * normal(random), 0.5 * normal(random));
    std::vector<double> mu(static_cast<std::size_t>(contacts));
    for (double& m : mu) m = trial % 4 == 0 && uniform(random, 0, 1) < 0.3 ? 0 : uniform(random, 0.05, 0.8);
    const Solved s = solve(W, q, mu);
    ASSERT_EQ(s.result.status, SolveStatus::solved) << trial << " residual " << s.result.residual;
    ASSERT_LT(coulomb_residual(W, q, s.lambda, mu), 2e-8);
    sliding += s.result.sliding;
    sticking += s.result.active - s.result.sliding;
    MatX A = W;
    A.diagonal() *= 1 + CoulombOptions().relative_diagonal;
    const VecX delta = A * s.lambda + q;
    double scale = 0;
    for (int i = 0; i < contacts; ++i)
      scale = std::max({scale, s.lambda.segment<3>(3 * i).norm(), q.segment<3>(3 * i).norm()});
    for (int i = 0; i < contacts; ++i)
      expect_coulomb(s.lambda.segment<3>(3 * i), delta.segment<3>(3 * i), mu[static_cast<std::size_t>(i)],
                     W.block<3, 3>(3 * i, 3 * i).trace() / 3, scale, 2e-7);
  }
  EXPECT_GT(sliding, 200);
  EXPECT_GT(sticking, 200);
}

TEST(Coulomb, WithoutFrictionIsTheLcp) {
  Random random(4);
  const auto workspace = std::make_unique<LcpWorkspace>();
  for (int trial = 0; trial < 100; ++trial) {
    const int contacts = 1 + trial % 12;
    const MatX W = tissue_like(random, contacts, 0.1);
    VecX q(3 * contacts);
    for (int k = 0; k < q.size(); ++k) q[k] = normal(random);
    const std::vector<double> mu(static_cast<std::size_t>(contacts), 0.0);
    CoulombOptions options;
    options.tolerance = 1e-11;
    const Solved s = solve(W, q, mu, options);
    const MatX W_n = W(Eigen::seqN(0, contacts, 3), Eigen::seqN(0, contacts, 3));
    const VecX q_n = q(Eigen::seqN(0, contacts, 3));
    VecX z(contacts);
    std::vector<std::uint8_t> active(static_cast<std::size_t>(contacts), 0);
    solve_lcp(W_n, q_n, z, active, *workspace, 0, {});
    for (int i = 0; i < contacts; ++i) {
      EXPECT_NEAR(s.lambda[3 * i], z[i], 1e-6 * (1 + z.maxCoeff()));
      EXPECT_EQ(s.lambda[3 * i + 1], 0);
      EXPECT_EQ(s.lambda[3 * i + 2], 0);
    }
  }
}

TEST(Coulomb, TangentFrameDoesNotMatter) {
  Random random(5);
  CoulombOptions options;
  options.tolerance = 1e-11;
  for (int trial = 0; trial < 60; ++trial) {
    const int contacts = 1 + trial % 10;
    const MatX W = tissue_like(random, contacts, 0.1);
    VecX q(3 * contacts);
    for (int i = 0; i < contacts; ++i)
      q.segment<3>(3 * i) = Vec3(normal(random) - 1, 0.5 * normal(random), 0.5 * normal(random));
    const std::vector<double> mu(static_cast<std::size_t>(contacts), 0.3);
    MatX R = MatX::Zero(q.size(), q.size());
    for (int i = 0; i < contacts; ++i)
      R.block<3, 3>(3 * i, 3 * i) =
          Eigen::AngleAxisd(uniform(random, 0, 6), Vec3::UnitX()).toRotationMatrix();
    const VecX turned = solve(R * W * R.transpose(), R * q, mu, options).lambda;
    EXPECT_LT((R.transpose() * turned - solve(W, q, mu, options).lambda).norm(), 1e-7 * (1 + turned.norm()));
  }
}

TEST(Coulomb, WarmStartAtTheSolutionCostsNoSweep) {
  Random random(6);
  const auto workspace = std::make_unique<CoulombWorkspace>();
  const MatX W = tissue_like(random, 12, 0.1);
  const VecX q = VecX::Constant(36, -1.0);
  const std::vector<double> mu(12, 0.3);
  VecX lambda = solve(W, q, mu).lambda;
  const CoulombResult again = solve_coulomb(W, q, mu, lambda, *workspace, 0, {});
  EXPECT_EQ(again.sweeps, 0);
  EXPECT_EQ(again.status, SolveStatus::solved);
}

TEST(Coulomb, SweepsAloneReachTheSameForce) {
  Random random(7);
  for (int trial = 0; trial < 20; ++trial) {
    const int contacts = 8;
    const MatX W = tissue_like(random, contacts, 0.1);
    VecX q(3 * contacts);
    for (int i = 0; i < contacts; ++i)
      q.segment<3>(3 * i) = Vec3(-1, 0.3 * normal(random), 0.3 * normal(random));
    const std::vector<double> mu(static_cast<std::size_t>(contacts), 0.3);
    CoulombOptions sweeps;
    sweeps.max_newton = 0;
    sweeps.max_sweeps = 20000;
    const Solved a = solve(W, q, mu, sweeps), b = solve(W, q, mu);
    EXPECT_EQ(a.result.newton, 0);
    EXPECT_LT((a.lambda - b.lambda).norm(), 1e-5 * b.lambda.norm());
  }
}

// A new right-hand side under the same W: the kept LU serves, and a wrong promise is the caller's alone.
TEST(Coulomb, KeptFactorGivesTheSameForce) {
  Random random(9);
  const auto kept = std::make_unique<CoulombWorkspace>();
  const MatX W = tissue_like(random, 12, 0.1);
  const std::vector<double> mu(12, 0.3);
  VecX q = VecX::Constant(36, -1.0), lambda = VecX::Zero(36);
  int factorisations = 0, fresh = 0;
  for (int tick = 0; tick < 40; ++tick) {
    for (int i = 0; i < 12; ++i) q.segment<3>(3 * i) += 1e-3 * Vec3(normal(random), normal(random), 0.5);
    VecX other = lambda;
    factorisations += solve_coulomb(W, q, mu, lambda, *kept, 7, {}).factorisations;
    const auto anew = std::make_unique<CoulombWorkspace>();
    fresh += solve_coulomb(W, q, mu, other, *anew, 0, {}).factorisations;
    EXPECT_LT((lambda - other).norm(), 1e-6 * other.norm());
  }
  EXPECT_LT(2 * factorisations, fresh);
}

// A clock that loses a microsecond at every look: the answer is the best iterate, and says so.
TEST(Coulomb, DeadlineReturnsTheBestIterate) {
  Random random(10);
  const auto workspace = std::make_unique<CoulombWorkspace>();
  const int contacts = 30;
  const MatX W = tissue_like(random, contacts, 0.1);
  const std::vector<double> mu(contacts, 0.5);
  VecX q(3 * contacts);
  for (int i = 0; i < contacts; ++i)
    q.segment<3>(3 * i) = Vec3(-1, 0.5 * normal(random), 0.5 * normal(random));
  double before = std::numeric_limits<double>::infinity();
  int capped = 0;
  for (const std::int64_t budget : {1'000, 4'000, 16'000, 64'000, 1'000'000}) {
    struct Clock {
      mutable std::int64_t left;
    } const clock{budget};
    CoulombOptions options;
    options.deadline.clock = &clock;
    options.deadline.left_ns = [](const void* c) noexcept {
      return static_cast<const Clock*>(c)->left -= 1000;
    };
    VecX lambda = VecX::Zero(q.size());
    const CoulombResult r = solve_coulomb(W, q, mu, lambda, *workspace, 0, options);
    const double residual = coulomb_residual(W, q, lambda, mu);
    EXPECT_NEAR(r.residual, residual, 1e-6 * (1 + residual));
    EXPECT_LE(r.residual, before);
    before = r.residual;
    capped += r.status == SolveStatus::deadline;
    if (budget == 1'000'000) {
      EXPECT_EQ(r.status, SolveStatus::solved);
    }
  }
  EXPECT_GT(capped, 0);
}

TEST(Coulomb, CapAndNotFiniteAreStatuses) {
  Random random(8);
  const MatX W = tissue_like(random, 10, 10.0);
  VecX q = VecX::Constant(30, -1.0);
  const std::vector<double> mu(10, 0.5);
  CoulombOptions options;
  options.max_sweeps = 1;
  options.max_newton = 0;
  const Solved capped = solve(W, q, mu, options);
  EXPECT_EQ(capped.result.status, SolveStatus::iteration_cap);
  EXPECT_TRUE(capped.lambda.allFinite());
  EXPECT_GT(capped.result.residual, options.tolerance);
  q[4] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(solve(W, q, mu).result.status, SolveStatus::not_finite);
  EXPECT_TRUE(solve(W, q, mu).lambda.isZero(0));
}

TEST(Coulomb, ProjectionWithoutFrictionAndWithoutTangentIsNeverNegative) {
  EXPECT_TRUE(project_on_cone(Vec3(-1, 0, 0), 0).isZero(0));
  EXPECT_EQ(project_on_cone(Vec3(2, 0, 0), 0), Vec3(2, 0, 0));
}

}  // namespace
}  // namespace hapticd
