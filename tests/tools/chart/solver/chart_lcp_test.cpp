// The chart of contact solvers: the sequences it measures on, the peers' solver, and the command as a person
// runs it.
#include "tools/chart/solver/chart_lcp.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "physics/contact/solver/coulomb.h"
#include "tests/support/contact_problems.h"
#include "tests/tools/run_command.h"
#include "tools/chart/solver/pgs_baseline.h"

namespace hapticd {
namespace {

SequenceSettings settings_of(std::size_t kind, bool friction) {
  SequenceSettings s;
  s.kind = static_cast<ContactCase>(kind);
  s.contacts = 9;
  s.friction = friction;
  s.steps_per_stroke = 60;
  return s;
}

// Follows the sequence with our own solver; visits every problem.
template <typename Visit>
void follow(ContactSequence& sequence, int steps, const Visit& visit) {
  const auto workspace = std::make_unique<CoulombWorkspace>();
  VecX lambda;
  for (int step = 0; step < steps; ++step) {
    sequence.advance(lambda);
    sequence.carry(lambda);
    if (lambda.size() == 0) lambda = VecX::Zero(sequence.rows());
    solve_coulomb(sequence.W(), sequence.q(), sequence.mu(), lambda, *workspace, sequence.version(), {});
    visit(lambda);
  }
}

TEST(ContactSequence, WIsSymmetricAndSemidefiniteInEveryCaseAndContactHappens) {
  for (std::size_t kind = 0; kind < contact_case_names().size(); ++kind) {
    ContactSequence sequence(settings_of(kind, true));
    int active = 0;
    std::uint64_t seen = 0;
    follow(sequence, 60, [&](const VecX& lambda) {
      active += (lambda.array() > 0).any();
      if (sequence.version() == seen) return;
      seen = sequence.version();
      const MatX& W = sequence.W();
      ASSERT_EQ(W, W.transpose());
      const Eigen::SelfAdjointEigenSolver<MatX> eigen(W, Eigen::EigenvaluesOnly);
      EXPECT_GT(eigen.eigenvalues().minCoeff(), -1e-12 * eigen.eigenvalues().maxCoeff());
    });
    EXPECT_GT(active, 20) << contact_case_names()[kind];
    EXPECT_EQ(seen, 3u);
  }
}

TEST(ContactSequence, IsAFunctionOfItsSeed) {
  for (const std::uint64_t seed : {1, 2}) {
    SequenceSettings s = settings_of(1, true);
    ContactSequence first(s), second(s);
    s.seed = seed + 1;
    ContactSequence other(s);
    std::vector<VecX> a, b, c;
    follow(first, 70, [&](const VecX&) { a.push_back(first.q()); });
    follow(second, 70, [&](const VecX&) { b.push_back(second.q()); });
    follow(other, 70, [&](const VecX&) { c.push_back(other.q()); });
    EXPECT_EQ(a, b);
    if (seed == 1) {
      EXPECT_NE(a, c);
    }
  }
}

TEST(ContactSequence, RigidObstaclesHaveRankSixWithoutTheirOwnCompliance) {
  ContactSequence sequence(settings_of(static_cast<std::size_t>(ContactCase::rigid), true));
  sequence.advance({});
  const Eigen::SelfAdjointEigenSolver<MatX> eigen(sequence.W_unregularised(), Eigen::EigenvaluesOnly);
  const VecX values = eigen.eigenvalues();
  EXPECT_LT(values[values.size() - 7], 1e-12 * values.maxCoeff());
}

TEST(PeerSolver, ReachesTheSameForceWithoutFriction) {
  Random random(4);
  const auto lcp = std::make_unique<LcpWorkspace>();
  for (int trial = 0; trial < 50; ++trial) {
    const MatX W = random_psd(random, 8, 20) + 5 * MatX::Identity(8, 8);
    VecX q(8);
    for (double& x : q) x = normal(random);
    VecX z(8), theirs = VecX::Zero(8);
    std::vector<std::uint8_t> active(8, 0);
    solve_lcp(W, q, z, active, *lcp, 0, {});
    EXPECT_TRUE(solve_projected(W, q, {}, theirs, 1e-10, 100000, {}).solved);
    EXPECT_LT((z - theirs).norm(), 1e-7 * (1 + z.norm()));
  }
}

TEST(ChartLcp, QuickRunWritesEveryPoint) {
  const ScratchDirectory directory;
  const CommandResult ran =
      run_haptic("chart lcp --cases round,stale --rows 10 --contacts 10 --steps 60 --json " +
                 directory.file("lcp.json") + " --csv " + directory.file("lcp.csv"));
  ASSERT_EQ(ran.code, 0) << ran.output;
  std::ifstream in(directory.file("lcp.json"));
  const auto json = nlohmann::json::parse(in);
  std::set<std::string> solvers, cases;
  for (const auto& p : json["points"]) {
    for (const char* key : {"solver", "rows", "contacts", "friction", "case", "warm", "us_median", "us_p99",
                            "us_p99_9", "us_max", "residual_max", "failures"})
      EXPECT_TRUE(p.contains(key)) << key;
    EXPECT_GT(p["us_p99"], 0.0);
    solvers.insert(p["solver"]);
    cases.insert(p["case"]);
  }
  EXPECT_EQ(solvers, (std::set<std::string>{"pivoting", "hybrid", "hybrid_400us", "hybrid_1e-10",
                                            "block_gauss_seidel", "pgs"}));
  EXPECT_EQ(cases, (std::set<std::string>{"round", "stale"}));
}

// What is called solved is solved, in every case and start; and the loop of ticks has been through contact.
// How much of the force a budget of real time costs is a matter of the machine: the chart's, not this test's.
TEST(ChartLcp, HardCasesAreSolvedWhereTheySayAndAreFeltInALoopOfTicks) {
  const ScratchDirectory directory;
  const CommandResult ran = run_haptic(
      "chart lcp --cases flat_stale,wedge,badly_scaled --rows 10,30 --contacts 10 --steps 100 --strokes 1 "
      "--json " +
      directory.file("lcp.json") + " --csv " + directory.file("lcp.csv"));
  ASSERT_EQ(ran.code, 0) << ran.output;
  std::ifstream in(directory.file("lcp.json"));
  const auto json = nlohmann::json::parse(in);
  std::set<std::string> cases, felt;
  for (const auto& p : json["points"]) {
    cases.insert(p["case"]);
    if (p["solver"] != "pgs") {
      EXPECT_EQ(p["solved_but_wrong"], 0) << p;
    }
  }
  EXPECT_EQ(cases, (std::set<std::string>{"flat_stale", "wedge", "badly_scaled"}));
  for (const auto& t : json["ticks"]) {
    felt.insert(t["case"]);
    EXPECT_EQ(t["ticks"], 600) << t;
    EXPECT_EQ(t["unusable_in_full"], 0) << t;
    EXPECT_GT(t["full_force_max"], 0.005) << t;
    EXPECT_LE(t["longest_unusable_ticks"], t["unusable_ticks"]) << t;
    EXPECT_TRUE(t["force_error_rms"].is_number()) << t;
  }
  EXPECT_EQ(felt, cases);
  std::ifstream csv(directory.file("lcp.csv"));
  std::string header;
  std::getline(csv, header);
  EXPECT_NE(header.find(",solved_but_wrong,"), std::string::npos) << header;
}

// Compliances as far apart as the case says, and walls that face one another.
TEST(DrawnContacts, AreAsHardAsTheirNamesSay) {
  std::mt19937_64 random(3);
  double least = 1e300, largest = 0;
  for (int k = 0; k < 20; ++k) {
    const DrawnContacts d = draw_badly_scaled(random, 20, 3);
    least = std::min(least, d.W.diagonal().minCoeff());
    largest = std::max(largest, d.W.diagonal().maxCoeff());
  }
  EXPECT_GT(largest / least, 1e11);
  const DrawnContacts wedge = draw_wedge(random, 10, 3);
  for (int i = 0; i < 10; ++i) EXPECT_EQ(wedge.J(3 * i, 0) > 0, i % 2 == 0);
  EXPECT_NEAR(wedge.J(0, 0), -wedge.J(3, 0), 1e-15);
}

TEST(ChartLcp, ADirectoryWithoutCapturesIsAnInputError) {
  const CommandResult ran = run_haptic("chart lcp --from /nowhere/at/all");
  EXPECT_EQ(ran.code, 2);
  EXPECT_NE(ran.output.find("/nowhere/at/all"), std::string::npos) << ran.output;
}

}  // namespace
}  // namespace hapticd
