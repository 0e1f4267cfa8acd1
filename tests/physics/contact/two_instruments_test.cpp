// Several instruments in one condensed problem, and where they touch one another.
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

constexpr double period = 1e-3;

InstrumentPoses both(const Pose& a, const Pose& b) {
  InstrumentPoses X(a);
  X[1] = b;
  X.present[1] = true;
  return X;
}

Pose at(const Vec3& p) { return {p, Quat::Identity()}; }

struct Loop {
  ContactOptions options;
  ContactState state;
  std::unique_ptr<ContactScratch> scratch = std::make_unique<ContactScratch>();

  Loop() { options.margin = 0.3e-3; }
  ContactSolution solve(const CondensedProblem& problem, Instruments instruments, const InstrumentPoses& X) {
    return solve_contact(problem, instruments, X, period, options, state, *scratch);
  }
  ContactSolution hold(const CondensedProblem& problem, Instruments instruments, const InstrumentPoses& X,
                       int ticks) {
    ContactSolution out;
    for (int t = 0; t < ticks; ++t) out = solve(problem, instruments, X);
    return out;
  }
};

// Two nodes 10 mm apart, each on a spring of its own and both on one another's: C = [a c; c b] ⊗ I, a sample
// on each.
std::unique_ptr<CondensedProblem> two_springs(double a, double b, double c, double friction) {
  auto problem = spring_problem(1 / a, Vec3(-5e-3, 0, 0), friction);
  problem->nodes = 2;
  problem->x_free[1] = problem->x_now[1] = Vec3(5e-3, 0, 0);
  MatX C(6, 6);
  C << a * Mat3::Identity(), c * Mat3::Identity(), c * Mat3::Identity(), b * Mat3::Identity();
  problem->C() = C;
  problem->samples = 2;
  problem->sample[1] = problem->sample[0];
  problem->sample[1].id = 2;
  problem->sample[1].node = {1, 1, 1};
  return problem;
}

// λ = (C + diag K⁻¹)⁻¹ d for depths d; where that would pull, the hand that pulls has left and the other is
// alone.
TEST(TwoInstruments, OnTwoSpringsByHand) {
  const double a = 1.0 / 40, b = 1.0 / 70, c = 0.01, r = 1e-3, K[] = {300, 150};
  const std::vector<Instrument> spheres = {sphere_instrument(r), sphere_instrument(r)};
  for (const double friction : {0.0, 0.4})
    for (const auto& d : {Eigen::Vector2d(0.3e-3, 0.2e-3), Eigen::Vector2d(0.3e-3, 0.02e-3)}) {
      const auto problem = two_springs(a, b, c, friction);
      for (int i = 0; i < 2; ++i) problem->instrument[i].coupling = {K[i], 0, 0};
      Eigen::Matrix2d W;
      W << a + 1 / K[0], c, c, b + 1 / K[1];
      Eigen::Vector2d by_hand = W.inverse() * d;
      if (by_hand[1] < 0) by_hand = Eigen::Vector2d(d[0] / W(0, 0), 0);
      Loop loop;
      const ContactSolution out =
          loop.hold(*problem, spheres, both(at({-5e-3, 0, r - d[0]}), at({5e-3, 0, r - d[1]})), 5);
      for (int i = 0; i < 2; ++i)
        EXPECT_NEAR(out.wrench[i][2], by_hand[i], 1e-8 * by_hand[0]) << d.transpose();
      EXPECT_EQ(out.active, by_hand[1] > 0 ? 2 : 1);
      const Eigen::Vector2d u = W * by_hand - Eigen::Vector2d(by_hand[0] / K[0], by_hand[1] / K[1]);
      for (int n = 0; n < 2; ++n) EXPECT_NEAR(loop.scratch->x[n].z(), -u[n], 1e-8 * u[0]);
    }
}

// Two spheres, tilted and turned at random, side by side in a sheet and in one another, both couplings soft
// in all.
struct Pressed {
  std::unique_ptr<CondensedProblem> problem;
  std::vector<Instrument> instruments = {sphere_instrument(1.6e-3), sphere_instrument(1.3e-3)};
  InstrumentPoses X;
  EachInstrument<Vec6> K_inv;
  std::unique_ptr<ContactRows> rows = std::make_unique<ContactRows>();

  explicit Pressed(std::uint64_t seed, double friction, double apart = 2.6e-3) {
    Random random(seed);
    SheetSettings sheet;
    sheet.friction = friction;
    problem = sheet_problem(random, sheet);
    problem->instrument_friction = friction;
    problem->instrument[1].coupling = {120, 0.01, 1e-3};
    const auto place = [&](double x, double r, Instrument& instrument) {
      const Vec3 shift = 0.1e-3 * unit_vector(random);
      instrument.primitives[0].placement.p = shift;
      const Quat q = random_rotation(random);
      return Pose{Vec3(x, uniform(random, -0.2e-3, 0.2e-3), r - 0.3e-3) - q * shift, q};
    };
    const Pose one = place(-0.5 * apart, 1.6e-3, instruments[0]),
               two = place(0.5 * apart, 1.3e-3, instruments[1]);
    X = both(one, two);
    for (int i = 0; i < 2; ++i) K_inv[i] = inverse_stiffness(problem->instrument[i].coupling, period);
    build();
  }
  void build() {
    build_rows(*problem, instruments, X, X, problem->x_free, K_inv, ContactMemory{}, 0.5e-3, *rows);
  }
  int pairs() const {
    int count = 0;
    for (int i = 0; i < rows->contacts; ++i) count += rows->row[i].other >= 0;
    return count;
  }
  // J of instrument i, 0 in the rows of others; where two touch the other moves its point the other way.
  MatX J(int instrument) const {
    MatX J = MatX::Zero(rows->rows(), 6);
    const int m = rows->rows_per_contact;
    for (int i = 0; i < rows->contacts; ++i)
      for (int c = 0; c < m; ++c) {
        const ContactRow& row = rows->row[i];
        const Vec3 f = row.frame.col(c);
        if (row.instrument == instrument) J.row(m * i + c) << -f.transpose(), -row.arm.cross(f).transpose();
        if (row.other == instrument) J.row(m * i + c) << f.transpose(), row.other_arm.cross(f).transpose();
      }
    return J;
  }
  MatX H() const {
    MatX H = MatX::Zero(rows->rows(), 3 * problem->nodes);
    const int m = rows->rows_per_contact;
    for (int i = 0; i < rows->contacts; ++i)
      for (int c = 0; rows->row[i].other < 0 && c < m; ++c)
        for (int a = 0; a < 3; ++a) {
          const PatchSample& s = problem->sample[rows->row[i].sample];
          H.block<1, 3>(m * i + c, 3 * s.node[a]) += s.weight[a] * rows->row[i].frame.col(c).transpose();
        }
    return H;
  }
};

// W = H C Hᵀ + Σ_i J_i K_i⁻¹ J_iᵀ, and a thousandth more on the diagonal where two rigid instruments touch.
TEST(TwoInstruments, DelassusIsThatOfADenseAssembly) {
  for (const double friction : {0.0, 0.3})
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      const Pressed s(seed, friction);
      ASSERT_EQ(s.pairs(), 1);
      MatX couplings = MatX::Zero(s.rows->rows(), s.rows->rows());
      for (int i = 0; i < 2; ++i) couplings += s.J(i) * s.K_inv[i].asDiagonal() * s.J(i).transpose();
      MatX dense = s.H() * s.problem->C() * s.H().transpose() + couplings;
      // The couplings' mean over the three directions of the pair's point.
      const ContactRow& pair = s.rows->row[s.rows->contacts - 1];
      double mean = 0;
      for (int c = 0; c < 3; ++c) {
        const Vec3 f = Vec3::Unit(c);
        const auto add = [&](const Vec6& K_inv, const Vec3& arm) {
          mean += (f.dot(K_inv.head<3>().cwiseProduct(f)) +
                   arm.cross(f).dot(K_inv.tail<3>().cwiseProduct(arm.cross(f)))) /
                  3;
        };
        add(s.K_inv[0], pair.arm);
        add(s.K_inv[1], pair.other_arm);
      }
      dense.diagonal().tail(s.rows->rows_per_contact).array() += 1e-3 * mean;
      EXPECT_LT((s.rows->W() - dense).norm(), 1e-13 * dense.norm());
      EXPECT_EQ((s.rows->W() - s.rows->W().transpose()).norm(), 0);
      EXPECT_GT(Eigen::SelfAdjointEigenSolver<MatX>(MatX(s.rows->W())).eigenvalues()[0],
                -1e-14 * dense.trace());
    }
}

// Two hands know of one another through tissue alone: without it their rows are not coupled at all.
TEST(TwoInstruments, RowsOfTwoHaveNoCouplingInCommon) {
  for (const double friction : {0.0, 0.3}) {
    Pressed s(1, friction, 3.2e-3);
    ASSERT_EQ(s.pairs(), 1);
    s.problem->C().setZero();
    s.build();
    const int m = s.rows->rows_per_contact;
    int crosses = 0;
    for (int i = 0; i < s.rows->contacts; ++i)
      for (int j = 0; j < s.rows->contacts; ++j) {
        const ContactRow &a = s.rows->row[i], &b = s.rows->row[j];
        if (a.other >= 0 || b.other >= 0 || a.instrument == b.instrument) continue;
        ++crosses;
        EXPECT_EQ(MatX(s.rows->W().block(m * i, m * j, m, m)).norm(), 0);
      }
    EXPECT_GT(crosses, 20);
  }
}

// The force on the tissue, from where its nodes went: Σ C⁻¹ (x − x_free).
Vec3 force_on_tissue(const CondensedProblem& problem, const PatchPositions& x) {
  VecX u(3 * problem.nodes);
  for (int n = 0; n < problem.nodes; ++n) u.segment<3>(3 * n) = x[n] - problem.x_free[n];
  const VecX f = Eigen::LLT<MatX>(MatX(problem.C())).solve(u);
  Vec3 sum = Vec3::Zero();
  for (int n = 0; n < problem.nodes; ++n) sum += f.segment<3>(3 * n);
  return sum;
}

TEST(TwoInstruments, ForcesOnBothAndOnTheTissueAddUpToNothing) {
  for (const double friction : {0.0, 0.3})
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      const Pressed s(seed, friction);
      Loop loop;
      InstrumentPoses X = s.X;
      ContactSolution out;
      for (int t = 0; t < 20; ++t) {  // dragged: some slide, some stick
        X[0].p += Vec3(8e-6, 3e-6, 0);
        X[1].p += Vec3(-8e-6, 5e-6, 0);
        out = loop.solve(*s.problem, s.instruments, X);
      }
      const ContactRow& last = loop.scratch->rows.row[out.contacts - 1];
      ASSERT_GE(last.other, 0);
      ASSERT_GT(loop.scratch->lambda[loop.scratch->rows.rows() - loop.scratch->rows.rows_per_contact], 1e-3);
      const Vec3 one = out.wrench[0].head<3>(), two = out.wrench[1].head<3>();
      const double size = one.norm() + two.norm();
      ASSERT_GT(size, 1e-2);
      EXPECT_LT((one + two + force_on_tissue(*s.problem, loop.scratch->x)).norm(), 1e-12 * size);
    }
}

// The other hand far from everything, taken out, or not in the world at all.
TEST(TwoInstruments, OneAloneIsUnchangedBitForBit) {
  for (const double friction : {0.0, 0.3})
    for (const Renewal renewal : {Renewal::renewed, Renewal::frozen}) {
      Pressed s(3, friction);
      s.problem->renewal = renewal;
      s.problem->instrument[0].X_ref = s.X[0];
      s.problem->instrument[1].X_ref = at({1, 0, 0});
      const std::vector<Instrument> alone = {s.instruments[0]};
      Loop one, far, absent;
      for (int t = 0; t < 60; ++t) {
        InstrumentPoses X(at(s.X[0].p + t * Vec3(9e-6, -4e-6, -3e-6)));
        const ContactSolution a = one.solve(*s.problem, alone, X);
        EXPECT_EQ(absent.solve(*s.problem, s.instruments, X).wrench[0], a.wrench[0]);
        const ContactSolution b = far.solve(*s.problem, s.instruments, both(X[0], at({1, t * 1e-3, 0})));
        EXPECT_EQ(b.wrench[0], a.wrench[0]);
        EXPECT_EQ(b.instrument[0].p, a.instrument[0].p);
        EXPECT_EQ(b.instrument[0].q.coeffs(), a.instrument[0].q.coeffs());
        EXPECT_EQ(b.penetration, a.penetration);
        EXPECT_TRUE(b.wrench[1].isZero(0));
      }
    }
}

// Which of the two is the first is nothing that either feels.
TEST(TwoInstruments, NeitherFeelsWhichOfThemIsTheFirst) {
  for (const double friction : {0.0, 0.3})
    for (std::uint64_t seed = 0; seed < 10; ++seed) {
      const Pressed s(seed, friction);
      const auto other = std::make_unique<CondensedProblem>(*s.problem);
      std::swap(other->instrument[0], other->instrument[1]);
      const std::vector<Instrument> swapped = {s.instruments[1], s.instruments[0]};
      Loop one, two;
      for (Loop* loop : {&one, &two}) loop->options.coulomb.tolerance = 1e-13;
      for (int t = 0; t < 20; ++t) {
        InstrumentPoses X = s.X;
        X[0].p += t * Vec3(8e-6, 3e-6, 0);
        const ContactSolution a = one.solve(*s.problem, s.instruments, X);
        const ContactSolution b = two.solve(*other, swapped, both(X[1], X[0]));
        for (int i = 0; i < 2; ++i)
          EXPECT_LT((a.wrench[i] - b.wrench[1 - i]).norm(), 1e-9 * a.wrench[i].norm()) << t;
      }
    }
}

// A hand that has gone leaves no force behind: the other feels what it would alone, and nothing is remembered
// of the hand that went, wherever it returns.
TEST(TwoInstruments, WhoHasGoneLeavesNothingBehind) {
  for (const double friction : {0.0, 0.3}) {
    const Pressed s(5, friction, 3.2e-3);
    const InstrumentPoses alone(s.X[0]);
    Loop loop, never;
    loop.hold(*s.problem, s.instruments, s.X, 20);
    ASSERT_GT(loop.state.coupling_offset[1].head<3>().norm(), 1e-5);
    const ContactSolution left = loop.hold(*s.problem, s.instruments, alone, 100);
    EXPECT_TRUE(left.wrench[1].isZero(0));
    EXPECT_TRUE(loop.state.coupling_offset[1].isZero(0));
    for (int m = 0; m < loop.state.memory.count; ++m) {
      EXPECT_EQ(loop.state.memory.entry[m].instrument, 0);
      EXPECT_FALSE(loop.state.memory.entry[m].id >> 56 == 0xff);
    }
    const Vec6 f = never.hold(*s.problem, s.instruments, alone, 100).wrench[0];
    // With friction what stuck while the other pressed may have stuck elsewhere.
    EXPECT_LT((left.wrench[0] - f).norm(), (friction > 0 ? 0.05 : 1e-9) * f.norm());
    InstrumentPoses back = s.X;
    back[1].p.z() += 2e-3;
    const ContactSolution returned = loop.solve(*s.problem, s.instruments, back);
    EXPECT_TRUE(returned.wrench[1].isZero(0));
    EXPECT_EQ(returned.instrument[1].p, back[1].p);
  }
}

}  // namespace
}  // namespace hapticd
