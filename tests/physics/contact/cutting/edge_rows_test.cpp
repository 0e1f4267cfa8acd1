// The law of cutting at a blade's edge: hand answers of one edge on a spring, the work of the hand, and what
// is remembered from one problem to the next.
#include "physics/contact/cutting/edge_rows.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "tests/support/contact_loop.h"
#include "tests/support/contact_problems.h"
#include "tests/support/malloc_guard.h"

namespace hapticd {
namespace {

constexpr double k = 50;        // tissue [N/m]
constexpr double limit = 5e-3;  // J w [N]

// One edge sample that points down, on a node of stiffness k at the height −advance.
std::unique_ptr<CondensedProblem> edge_problem(double advance = 0, std::uint64_t step = 1) {
  auto p = spring_problem(k, Vec3(0, 0, -advance), 0);
  p->samples = 0;
  p->step = step;
  p->edges = 1;
  p->edge[0] = {edge_id(0, 0),  0,     0,      {0, 0, 0, 0}, {1, 0, 0, 0}, Vec3::Zero(),
                -Vec3::UnitZ(), limit, advance};
  p->instrument[0].coupling = {};  // held rigidly
  return p;
}

Pose at(double depth) { return {Vec3(0, 0, -depth), Quat::Identity()}; }

struct Hand : ContactLoop {
  Instrument blade = sphere_instrument(1e-4);

  Hand() { options.coulomb.relative_diagonal = 1e-13; }
  // What the hand feels upwards [N].
  double force(const CondensedProblem& p, double depth) {
    const ContactSolution out = solve(p, blade, at(depth));
    EXPECT_EQ(out.status, SolveStatus::solved);
    EXPECT_LT(out.wrench[0].head<2>().norm() + out.wrench[0].tail<3>().norm(), 1e-15);
    return out.wrench[0][2];
  }
  double advance(const CondensedProblem& p) const { return advance_to_realise(p, state.memory, 0); }
};

TEST(Cutting, IsAContactBelowTheLimitAndAdvancesAtIt) {
  for (const Renewal renewal : {Renewal::renewed, Renewal::frozen}) {
    const auto p = edge_problem();
    p->renewal = renewal;
    p->instrument[0].X_ref = at(0);
    Hand hand;
    EXPECT_EQ(hand.force(*p, -0.1e-3), 0);
    EXPECT_NEAR(hand.force(*p, 0.05e-3), k * 0.05e-3, 1e-10 * limit);
    EXPECT_EQ(hand.advance(*p), 0);
    EXPECT_EQ(hand.force(*p, 0.3e-3), limit);
    EXPECT_NEAR(hand.advance(*p), 0.3e-3 - limit / k, 1e-15);
    EXPECT_EQ(hand.scratch->x[0], Vec3(0, 0, -limit / k));
    for (int tick = 0; tick < 1000; ++tick) EXPECT_NEAR(hand.force(*p, 0.3e-3), limit, 1e-12 * limit);
    EXPECT_NEAR(hand.advance(*p), 0.3e-3 - limit / k, 1e-15);
  }
}

TEST(Cutting, OnWithdrawingTheForceFallsAtOnceAndNothingHeals) {
  for (const Renewal renewal : {Renewal::renewed, Renewal::frozen}) {
    const auto p = edge_problem();
    p->renewal = renewal;
    Hand hand;
    hand.force(*p, 0.3e-3);
    const double cut = 0.3e-3 - limit / k;
    for (double back = 0; back < 0.25e-3; back += 7e-6)
      EXPECT_NEAR(hand.force(*p, 0.3e-3 - back), std::max(0.0, limit - k * back), 1e-9 * limit);
    for (double depth = 0; depth < cut + limit / k; depth += 7e-6)
      EXPECT_NEAR(hand.force(*p, depth), std::max(0.0, k * (depth - cut)), 1e-9 * limit);
    EXPECT_NEAR(hand.advance(*p), cut, 1e-15);
  }
}

// Grid of a tenth of the elastic way: all kinks of the force are on it, so the trapezoid is exact.
TEST(Cutting, WorkOfTheHandIsToughnessTimesAreaAndWhatIsElastic) {
  for (const double K : {0.0, 300.0}) {
    const auto p = edge_problem();
    p->instrument[0].coupling = {K, 0, 0};
    const double compliance = 1 / k + (K > 0 ? 1 / K : 0), grid = limit * compliance / 10;
    Hand hand;
    Random random(7);
    int place = -3, far = 0;
    double work = 0, last = 0;
    for (int stroke = 0; stroke < 200; ++stroke) {
      const int goal = far + static_cast<int>(uniform(random, -25, 8));
      while (place != goal) {
        const int way = goal > place ? 1 : -1;
        place += way;
        const double force = hand.force(*p, grid * place);
        work += 0.5 * (force + last) * grid * way;
        last = force;
        far = std::max(far, place);
      }
    }
    const double advance = hand.advance(*p);
    EXPECT_GT(advance, 20 * grid);
    EXPECT_NEAR(advance, grid * (far - 10), 1e-12);
    EXPECT_NEAR(work, limit * advance + 0.5 * last * last * compliance, 1e-9 * work) << K;
  }
}

// A step publishes every 20 ticks a front that has realised just what was cut; the hand goes to and fro.
TEST(Cutting, ASwapThatRealisesTheAdvanceIsNotFelt) {
  auto p = edge_problem();
  Hand hand;
  double cut = 0, mean = 0;
  int steady = 0;
  for (int tick = 0; tick < 4000; ++tick) {
    const double depth = 2e-3 * 1e-3 * tick + 0.2e-3 * std::sin(0.01 * tick);
    if (tick % 20 == 19) {
      const double before = hand.force(*p, depth), remembered = hand.state.memory.entry[0].advance;
      p = edge_problem(p->edge[0].advance + hand.advance(*p), p->step + 1);
      EXPECT_EQ(hand.advance(*p), 0);
      EXPECT_NEAR(hand.force(*p, depth), before, 1e-9 * limit);
      EXPECT_NEAR(hand.state.memory.entry[0].advance, remembered, 1e-15);
    }
    cut = std::max(cut, depth - limit / k);
    EXPECT_NEAR(hand.force(*p, depth), std::max(0.0, k * (depth - cut)), 1e-9 * limit) << tick;
  }
  for (int tick = 0; tick < 1000; ++tick, ++steady) {
    if (tick % 20 == 19) p = edge_problem(p->edge[0].advance + hand.advance(*p), p->step + 1);
    mean += hand.force(*p, 9e-3 + 10e-6 * tick);
  }
  EXPECT_NEAR(mean / steady, limit, 1e-9 * limit);
}

// What a loop cut beyond the published front stays cut; where the front is further, that counts.
TEST(Cutting, TheFartherOfRememberedAndPublishedFrontCounts) {
  const auto p = edge_problem();
  Hand hand;
  hand.force(*p, 0.4e-3);  // cut: 0.3 mm
  EXPECT_NEAR(hand.force(*edge_problem(0.2e-3, 2), 0.35e-3), k * 0.05e-3, 1e-9 * limit);
  EXPECT_NEAR(hand.force(*edge_problem(0.33e-3, 3), 0.35e-3), k * 0.02e-3, 1e-9 * limit);
  EXPECT_NEAR(hand.force(*edge_problem(0.2e-3, 4), 0.35e-3), k * 0.02e-3, 1e-9 * limit);
  hand.state = {};
  EXPECT_NEAR(hand.force(*edge_problem(0.3e-3, 5), 0.35e-3), k * 0.05e-3, 1e-9 * limit);
}

// Drawn steadily at v, the hand feels J w + c w v, whatever the tick is; at rest the force creeps to J w. Its
// work is J · area + elastic + Σ (c w/T) a².
TEST(Cutting, AViscousEdgeFeelsToughnessAndSpeed) {
  constexpr double viscosity = 0.05;  // c w [N·s/m]
  for (const Renewal renewal : {Renewal::renewed, Renewal::frozen})
    for (const double T : {1e-3, 20e-3})
      for (const double speed : {5e-3, 20e-3}) {
        const auto p = edge_problem();
        p->renewal = renewal;
        p->edge[0].viscosity = viscosity;
        Hand hand;
        hand.period = T;
        hand.options.coulomb.tolerance = 1e-12;
        EXPECT_NEAR(hand.force(*p, 0.5 * limit / k), 0.5 * limit, 1e-10 * limit);
        EXPECT_EQ(hand.advance(*p), 0);
        // The spring takes up the viscous force with the time constant c w/k = 1 ms.
        double depth = 0.5 * limit / k, last = 0.5 * limit, work = 0, damped = 0;
        const auto go = [&](double by) {
          const double before = hand.advance(*p), force = hand.force(*p, depth += by),
                       a = hand.advance(*p) - before;
          EXPECT_NEAR(force, a > 0 ? limit + viscosity * a / T : k * (depth - hand.advance(*p)),
                      1e-9 * limit);
          // Implicit Euler's own: the spring is taken up by the tick's last force.
          work += force * by - 0.5 * (force - last) * (force - last) / k;
          damped += viscosity * a * a / T;
          last = force;
        };
        for (int tick = 0; tick < 60; ++tick) go(speed * T);
        EXPECT_NEAR(last, limit + viscosity * speed, 1e-9 * limit) << T << ' ' << speed;
        const double elastic = 0.5 * (last * last - 0.25 * limit * limit) / k;
        EXPECT_NEAR(work, limit * hand.advance(*p) + elastic + damped, 1e-9 * work);
        for (int tick = 0; tick < 60; ++tick) go(0);
        EXPECT_NEAR(last, limit, 1e-9 * limit) << "it creeps until it is dry";
        EXPECT_NEAR(hand.force(*p, depth - 0.5 * limit / k), 0.5 * limit, 1e-9 * limit)
            << "at once, as if dry";
      }
}

// A sphere of 2 mm in a sheet, turned at random, with eight edge samples in front of it, each on four nodes.
struct Sheet {
  std::unique_ptr<CondensedProblem> problem;
  Instrument instrument = sphere_instrument(2e-3);
  Pose X;

  Sheet(std::uint64_t seed, double friction, double most) {
    Random random(seed);
    SheetSettings settings;
    settings.friction = friction;
    problem = sheet_problem(random, settings);
    X = {Vec3(uniform(random, -1e-3, 1e-3), uniform(random, -1e-3, 1e-3), 1.6e-3), random_rotation(random)};
    problem->instrument[0].X_ref = X;
    for (int e = 0; e < 8; ++e) {
      EdgeSample& edge = problem->edge[e];
      const int a = e % 4 + 5 * (e / 4 + 1);
      edge = {edge_id(0, e), 0,    0, {a, a + 1, a + 6, a + 5}, {0.1, 0.4, 0.2, 0.3}, Vec3::Zero(),
              Vec3::Zero(),  most, 0};
      edge.direction = X.q.conjugate() * (unit_vector(random) - 2 * Vec3::UnitZ()).normalized();
      const Vec3 front = front_position(*problem, problem->x_free, e);
      edge.place = X.to_local(front) + uniform(random, -0.05e-3, 0.15e-3) * edge.direction;
    }
    problem->edges = 8;
  }
};

TEST(Cutting, DelassusIsHCHtPlusJKJtWithFourNodes) {
  Vec6 coupling;
  coupling << 3e-3, 3e-3, 3e-3, 40, 40, 40;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Sheet s(seed, seed % 2 == 0 ? 0.3 : 0, limit);
    const auto rows = std::make_unique<ContactRows>();
    build_rows(*s.problem, s.instrument, s.X, s.X, s.problem->x_free, coupling, {}, 0.3e-3, *rows);
    ASSERT_EQ(rows->edges, 8);
    ASSERT_GT(rows->contacts, 10);
    ASSERT_EQ(rows->rows_per_contact, 3);
    const MatX H = dense_H(*s.problem, *rows), J = dense_J(*rows);
    const MatX dense = H * s.problem->C() * H.transpose() + J * coupling.asDiagonal() * J.transpose();
    EXPECT_LT((rows->W() - dense).norm(), 1e-13 * dense.norm());
    EXPECT_EQ((rows->W() - rows->W().transpose()).norm(), 0);
  }
}

// J is the derivative of δ_e by the instrument's twist, and δ_free that of a free motion of blade and tissue.
TEST(Cutting, JacobianIsTheGapsDerivative) {
  const Sheet s(3, 0, limit);
  const auto rows = std::make_unique<ContactRows>();
  build_rows(*s.problem, s.instrument, s.X, s.X, s.problem->x_free, Vec6(Vec6::Zero()), {}, 0.3e-3, *rows);
  const MatX J = dense_J(*rows);
  const double h = 1e-7;
  for (int i = rows->contacts - 8; i < rows->contacts; ++i) {
    const EdgeSample& e = s.problem->edge[rows->row[i].edge];
    const Vec3 x = front_position(*s.problem, s.problem->x_free, rows->row[i].edge);
    const auto gap = [&](const Pose& X) { return (X.q * e.direction).dot(x - X.to_world(e.place)); };
    EXPECT_NEAR(rows->q()[3 * i], gap(s.X), 1e-15);
    for (int c = 0; c < 6; ++c) {
      const Vec6 d = (c < 3 ? h : h / 2e-3) * Vec6::Unit(c);
      EXPECT_NEAR((gap(displaced(s.X, d)) - gap(displaced(s.X, -d))) / (2 * d[c]), J(3 * i, c),
                  1e-6 * (c < 3 ? 1 : 2e-3));
    }
  }
}

// With contacts of the sheet beside them, pressed, drawn along and withdrawn: the law holds for every edge.
TEST(Cutting, EdgesBesideContactsMeetTheLaw) {
  int inside = 0, limited = 0;
  for (const double friction : {0.0, 0.3})
    for (const Renewal renewal : {Renewal::renewed, Renewal::frozen})
      for (std::uint64_t seed = 0; seed < 25; ++seed) {
        const Sheet s(seed, friction, 1e-3);
        s.problem->renewal = renewal;
        ContactLoop loop;
        std::array<double, 8> cut{};
        for (int tick = 0; tick < 60; ++tick) {
          Pose X = s.X;
          X.p += Vec3(2e-6 * tick, 0, -0.15e-3 * std::sin(0.08 * tick));
          const ContactSolution out = loop.solve(*s.problem, s.instrument, X);
          ASSERT_EQ(out.status, SolveStatus::solved) << out.residual;
          const ContactRows& rows = loop.scratch->rows;
          ASSERT_EQ(rows.edges, 8);
          const Eigen::Map<const VecX> lambda(loop.scratch->lambda.data(), rows.rows());
          const VecX delta = rows.W() * lambda + rows.q();
          for (int i = rows.contacts - 8; i < rows.contacts; ++i) {
            const double l = lambda[3 * i], d = delta[3 * i], most = rows.row[i].limit;
            const double grown = advance_to_realise(*s.problem, loop.state.memory, rows.row[i].edge);
            double& before = cut[static_cast<std::size_t>(rows.row[i].edge)];
            EXPECT_TRUE(l >= 0 && l <= most);
            EXPECT_TRUE(lambda.segment<2>(3 * i + 1).isZero(0));
            EXPECT_GE(grown, before);
            // 0 ≤ λ ⟂ δ + a ≥ 0 to the solver's tolerance, and no advance below the limit.
            const double gap = d + grown - before, slack = 1e-7 * rows.W()(3 * i, 3 * i) * most;
            EXPECT_GE(gap, -slack);
            if (l > 0) {
              EXPECT_LE(gap, slack);
            }
            EXPECT_LE((most - l) * (grown - before), slack * most);
            inside += l > 0 && l < 0.999 * most;
            limited += grown > before;
            before = grown;
          }
        }
      }
  EXPECT_GT(inside, 1000);
  EXPECT_GT(limited, 1000);
}

TEST(Cutting, EdgesOfWhoIsAbsentAndNoEdgesAreTheSameBits) {
  for (const double friction : {0.0, 0.3}) {
    const Sheet s(5, friction, limit);
    for (int e = 0; e < 8; ++e) s.problem->edge[e].instrument = 1;
    const auto none = std::make_unique<CondensedProblem>(*s.problem);
    none->edges = 0;
    ContactLoop with, without;
    for (int tick = 0; tick < 50; ++tick) {
      Pose X = s.X;
      X.p.z() -= 5e-6 * tick;
      const ContactSolution a = with.solve(*s.problem, s.instrument, X),
                            b = without.solve(*none, s.instrument, X);
      EXPECT_EQ(a.wrench[0], b.wrench[0]);
      EXPECT_EQ(with.scratch->rows.rows_per_contact, friction > 0 ? 3 : 1);
    }
  }
}

TEST(Cutting, AllocatesNothing) {
  if (!MallocGuard::available()) GTEST_SKIP() << "malloc belongs to the sanitizer";
  const Sheet s(6, 0.3, 1e-3);
  const auto next = std::make_unique<CondensedProblem>();
  ContactLoop loop;
  const MallocGuard guard;
  double total = 0;
  for (int tick = 0; tick < 100; ++tick) {
    Pose X = s.X;
    X.p.z() -= 5e-6 * tick;
    if (tick % 20 == 0) {
      copy_in_use(*s.problem, *next);
      next->step = static_cast<std::uint64_t>(tick);
      for (int e = 0; e < next->edges; ++e)
        next->edge[e].advance += 0.5 * advance_to_realise(*next, loop.state.memory, e);
    }
    loop.solve(*next, s.instrument, X);
    for (int e = 0; e < next->edges; ++e) total += advance_to_realise(*next, loop.state.memory, e);
  }
  EXPECT_EQ(guard.allocations() + guard.frees(), 0);
  EXPECT_GT(total, 0);
}

}  // namespace
}  // namespace hapticd
