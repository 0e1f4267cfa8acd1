// More contacts than the haptic loop holds: the same solvers with a workspace that was made for them; what it
// was not made for is refused.
#include <gtest/gtest.h>

#include <limits>
#include <memory>

#include "physics/contact/solver/coulomb.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

struct Case {
  MatX W;
  VecX q;
  std::vector<double> mu;
};

// Contacts on a common tissue: full rank, or sharing fewer freedoms than they have rows.
Case seeded(Random& random, int contacts, int rank) {
  Case c;
  c.W = random_psd(random, 3 * contacts, rank);
  c.q.resize(3 * contacts);
  const double size = c.W.trace() / (3 * contacts);
  for (int i = 0; i < contacts; ++i) {
    c.q.segment<3>(3 * i) =
        size * Vec3(uniform(random, -1, 0.5), uniform(random, -1, 1), uniform(random, -1, 1));
    c.mu.push_back(i % 5 == 0 ? 0 : uniform(random, 0, 1));
  }
  return c;
}

TEST(ManyContacts, AreSolvedByAWorkspaceThatWasMadeForThem) {
  Random random(12);
  for (const int contacts : {101, 120, 200}) {
    CoulombWorkspace workspace(contacts);
    int failed = 0;
    for (int trial = 0; trial < 8; ++trial) {
      const Case c = seeded(random, contacts, 4 * contacts);
      VecX lambda = VecX::Zero(c.q.size());
      const CoulombResult r = solve_coulomb(c.W, c.q, c.mu, lambda, workspace, 0, {});
      failed += r.status != SolveStatus::solved;
      EXPECT_LT(coulomb_residual(c.W, c.q, lambda, c.mu), 1e-6);
      for (int i = 0; i < contacts; ++i) {
        EXPECT_GE(lambda[3 * i], 0);
        EXPECT_LE(lambda.segment<2>(3 * i + 1).norm(), c.mu[i] * lambda[3 * i] * (1 + 1e-9) + 1e-12);
      }
    }
    EXPECT_EQ(failed, 0) << contacts;
  }
}

TEST(ManyContacts, AreRefusedByAWorkspaceThatWasNot) {
  Random random(14);
  const auto coulomb = std::make_unique<CoulombWorkspace>();
  const auto lcp = std::make_unique<LcpWorkspace>();
  const Case c = seeded(random, max_contacts + 1, 3 * max_contacts + 3);
  VecX lambda = VecX::Ones(c.q.size());
  EXPECT_EQ(solve_coulomb(c.W, c.q, c.mu, lambda, *coulomb, 0, {}).status, SolveStatus::too_large);
  EXPECT_TRUE(lambda.isZero(0));
  VecX z = VecX::Ones(c.q.size());
  std::vector<std::uint8_t> active(static_cast<std::size_t>(z.size()), 1);
  EXPECT_EQ(solve_lcp(c.W, c.q, z, active, *lcp, 0, {}).status, SolveStatus::too_large);
  EXPECT_TRUE(z.isZero(0));
  LcpWorkspace enough(static_cast<int>(z.size()));
  EXPECT_EQ(solve_lcp(c.W, c.q, z, active, enough, 0, {}).status, SolveStatus::solved);
}

// Tangents that W does not move, as of an instrument without friction among bodies with it.
TEST(ManyContacts, FrictionlessOnesAmongOthersMayLeaveTheirTangentsOut) {
  Random random(13);
  const auto workspace = std::make_unique<CoulombWorkspace>();
  for (int trial = 0; trial < 50; ++trial) {
    Case c = seeded(random, 10, 60), full = c;
    for (int i = 0; i < 10; i += 5)
      for (int t = 1; t < 3; ++t) {
        c.W.row(3 * i + t).setZero();
        c.W.col(3 * i + t).setZero();
        c.q[3 * i + t] = 0;
      }
    VecX a = VecX::Zero(30), b = a;
    CoulombOptions options;
    options.tolerance = 1e-11;
    solve_coulomb(c.W, c.q, c.mu, a, *workspace, 0, options);
    solve_coulomb(full.W, full.q, full.mu, b, *workspace, 0, options);
    EXPECT_LT((a - b).norm(), 1e-7 * (1 + b.norm()));
  }
}

}  // namespace
}  // namespace hapticd
