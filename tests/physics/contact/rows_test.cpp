#include "physics/contact/rows.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <numeric>
#include <utility>
#include <vector>

#include "physics/contact/delassus_columns.h"
#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

const Vec6 no_coupling = Vec6::Zero();

Vec6 some_coupling() {
  Vec6 k;
  k << 3e-3, 3e-3, 3e-3, 40, 40, 40;
  return k;
}

// A sphere of 2 mm pressed 0.4 mm into a sheet of 8 mm, tilted and turned at random.
struct Scene {
  std::unique_ptr<CondensedProblem> problem;
  Instrument instrument = sphere_instrument(2e-3);
  Pose X;
  std::unique_ptr<ContactRows> rows = std::make_unique<ContactRows>();
  ContactMemory memory;
};

Scene pressed(std::uint64_t seed, double friction, double margin = 0.5e-3) {
  Random random(seed);
  Scene s;
  SheetSettings settings;
  settings.friction = friction;
  s.problem = sheet_problem(random, settings);
  s.X = {Vec3(uniform(random, -1e-3, 1e-3), uniform(random, -1e-3, 1e-3), 1.6e-3), random_rotation(random)};
  s.instrument.primitives[0].placement.p = 0.1e-3 * unit_vector(random);
  build_rows(*s.problem, s.instrument, s.X, s.X, s.problem->x_free, some_coupling(), s.memory, margin,
             *s.rows);
  return s;
}

Vec6 twist(Random& random, double size) {
  const Vec3 along = unit_vector(random), about = unit_vector(random);
  Vec6 d;
  for (int c = 0; c < 3; ++c) {
    d[c] = size * along[c];
    d[3 + c] = 200 * size * about[c];
  }
  return d;
}

TEST(ContactFrame, IsARotationWithTheNormalFirst) {
  Random random(1);
  for (int trial = 0; trial < 1000; ++trial) {
    const Vec3 n = trial == 0 ? Vec3(0, 0, -1) : trial == 1 ? Vec3(0, 0, 1) : unit_vector(random);
    const Mat3 F = contact_frame(n);
    EXPECT_EQ(F.col(0), n);
    EXPECT_LT((F.transpose() * F - Mat3::Identity()).norm(), 1e-14);
    EXPECT_NEAR(F.determinant(), 1, 1e-14);
  }
}

TEST(Rows, DelassusIsHCHtPlusJKJt) {
  for (const double friction : {0.0, 0.3})
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      const Scene s = pressed(seed, friction);
      ASSERT_GT(s.rows->contacts, 10);
      EXPECT_EQ(s.rows->rows_per_contact, friction > 0 ? 3 : 1);
      const MatX H = dense_H(*s.problem, *s.rows), J = dense_J(*s.rows);
      const MatX dense =
          H * s.problem->C() * H.transpose() + J * some_coupling().asDiagonal() * J.transpose();
      EXPECT_LT((s.rows->W() - dense).norm(), 1e-13 * dense.norm());
      EXPECT_EQ((s.rows->W() - s.rows->W().transpose()).norm(), 0);
      const double least = Eigen::SelfAdjointEigenSolver<MatX>(MatX(s.rows->W())).eigenvalues()[0];
      EXPECT_GT(least, -1e-14 * dense.trace());
    }
}

// Columns asked for in any order are those of the whole; before that the own blocks are there, and no other.
template <int m>
void columns_on_demand(Scene& s, DelassusColumns<m> EitherColumns::*of, Random& random) {
  const auto build = [&](EitherColumns* columns) {
    build_rows(*s.problem, s.instrument, s.X, s.X, s.problem->x_free, some_coupling(), s.memory, 0.5e-3,
               *s.rows, nullptr, nullptr, 0, columns);
  };
  build(nullptr);
  ASSERT_EQ(s.rows->rows_per_contact, m);
  const MatX whole = s.rows->W();
  const int n = s.rows->contacts;
  const double rounding = 1e-13 * whole.norm();
  s.rows->W().setConstant(1e300);
  const auto both = std::make_unique<EitherColumns>();
  build(both.get());
  DelassusColumns<m>& columns = (*both).*of;
  std::vector<int> order(static_cast<std::size_t>(n));
  std::iota(order.begin(), order.end(), 0);
  std::shuffle(order.begin(), order.end(), random);
  order.resize(order.size() / 2);
  for (const int j : order) columns.make(j);
  const auto block = [&](int i, int j) { return s.rows->W().template block<m, m>(m * i, m * j); };
  for (int j = 0; j < n; ++j) {
    const bool asked = std::find(order.begin(), order.end(), j) != order.end();
    EXPECT_LT((block(j, j) - whole.template block<m, m>(m * j, m * j)).norm(), rounding);
    if (!asked) continue;
    EXPECT_LT((s.rows->W().template middleCols<m>(m * j) - whole.template middleCols<m>(m * j)).norm(),
              rounding);
    for (const int i : order) EXPECT_EQ(block(i, j), block(j, i).transpose());
  }
  columns.make_all();
  EXPECT_LT((s.rows->W() - whole).norm(), rounding);
  EXPECT_EQ((s.rows->W() - s.rows->W().transpose()).norm(), 0);
}

TEST(Rows, ColumnsOnDemandAreThoseOfTheWhole) {
  Random random(5);
  for (std::uint64_t seed = 0; seed < 20; ++seed)
    for (const double friction : {0.0, 0.3}) {
      Scene s = pressed(seed, friction);
      for (int k = 0; k < s.problem->samples; k += 3) s.problem->sample[k].node = {-1, -1, -1};
      if (friction > 0)
        columns_on_demand<3>(s, &EitherColumns::whole, random);
      else
        columns_on_demand<1>(s, &EitherColumns::normal, random);
    }
}

TEST(Rows, FixedObstacleHasTheCouplingAndAThousandthMore) {
  Scene s = pressed(1, 0.3);
  for (int k = 0; k < s.problem->samples; ++k) {
    PatchSample& sample = s.problem->sample[k];
    sample.free = sample_position(*s.problem, s.problem->x_free, k);
    if (k % 2 == 0) sample.node = {-1, -1, -1};
  }
  build_rows(*s.problem, s.instrument, s.X, s.X, s.problem->x_free, some_coupling(), s.memory, 0.5e-3,
             *s.rows);
  const MatX H = dense_H(*s.problem, *s.rows), J = dense_J(*s.rows);
  MatX dense = H * s.problem->C() * H.transpose() + J * some_coupling().asDiagonal() * J.transpose();
  int fixed = 0;
  for (int i = 0; i < s.rows->contacts; ++i) {
    if (s.problem->sample[s.rows->row[i].sample].node[0] >= 0) continue;
    ++fixed;
    const double extra = 1e-3 * dense.block<3, 3>(3 * i, 3 * i).trace() / 3;
    dense.diagonal().segment<3>(3 * i).array() += extra;
  }
  EXPECT_GT(fixed, 3);
  EXPECT_LT((s.rows->W() - dense).norm(), 1e-13 * dense.norm());
}

// J is the derivative of the gap by the instrument's twist.
TEST(Rows, JacobianIsTheGapsDerivative) {
  const Scene s = pressed(2, 0.0);
  const MatX J = dense_J(*s.rows);
  const double h = 1e-7;
  for (int i = 0; i < s.rows->contacts; ++i) {
    const Vec3 x = sample_position(*s.problem, s.problem->x_free, s.rows->row[i].sample);
    for (int c = 0; c < 6; ++c) {
      const Vec6 d = (c < 3 ? h : h / 2e-3) * Vec6::Unit(c);
      const double up = gap_at(s.instrument, displaced(s.X, d), x).distance;
      const double down = gap_at(s.instrument, displaced(s.X, -d), x).distance;
      EXPECT_NEAR((up - down) / (2 * d[c]), J(i, c), 1e-6 * (c < 3 ? 1 : 2e-3));
    }
  }
}

TEST(Rows, WrenchDoesTheWorkOfTheContactForces) {
  for (const double friction : {0.0, 0.3}) {
    const Scene s = pressed(3, friction);
    Random random(3);
    std::vector<double> lambda(static_cast<std::size_t>(s.rows->rows()));
    for (double& l : lambda) l = normal(random);
    const Vec6 wrench = wrench_on_instruments(*s.rows, lambda)[0];
    const Eigen::Map<const VecX> l(lambda.data(), s.rows->rows());
    const VecX expected = dense_J(*s.rows).transpose() * l;
    EXPECT_LT((wrench - expected).norm(), 1e-13 * expected.norm());
  }
  // By hand: a sphere above the sheet is pushed up.
  const Scene s = pressed(4, 0.0);
  std::vector<double> lambda(static_cast<std::size_t>(s.rows->rows()), 1.0);
  EXPECT_GT(wrench_on_instruments(*s.rows, lambda)[0][2], 0);
}

// δ_free is the true gap of moved tissue and moved instrument, to first order: the error falls fourfold.
TEST(Rows, FreeGapIsTheGapToFirstOrderInTissueAndPose) {
  Scene s = pressed(5, 0.0);
  Random random(5);
  const Vec6 move = twist(random, 1.0);
  std::array<Vec3, max_patch_nodes> direction;
  for (Vec3& d : direction) d = unit_vector(random);
  const PatchPositions x_lin = s.problem->x_free;
  double previous = 0;
  for (const double size : {2e-5, 1e-5, 0.5e-5}) {
    for (int a = 0; a < s.problem->nodes; ++a) s.problem->x_free[a] = x_lin[a] + size * direction[a];
    const Pose X_free = displaced(s.X, size * move);
    build_rows(*s.problem, s.instrument, X_free, s.X, x_lin, some_coupling(), s.memory, 0.5e-3, *s.rows);
    double worst = 0;
    for (int i = 0; i < s.rows->contacts; ++i) {
      const Vec3 x = sample_position(*s.problem, s.problem->x_free, s.rows->row[i].sample);
      worst = std::max(worst, std::abs(s.rows->q()[i] - gap_at(s.instrument, X_free, x).distance));
    }
    EXPECT_LT(worst, 1e3 * size * size);
    if (previous > 0) {
      EXPECT_NEAR(previous / worst, 4.0, 0.3);
    }
    previous = worst;
  }
}

TEST(Rows, SlipIsMeasuredFromTheAnchorInTheMovingInstrument) {
  Scene s = pressed(6, 0.3);
  Random random(6);
  s.memory.count = s.rows->contacts;
  const double size = 1e-6;
  for (int i = 0; i < s.rows->contacts; ++i) {
    const Vec3 x = sample_position(*s.problem, s.problem->x_free, s.rows->row[i].sample);
    s.memory.entry[i] = {s.rows->row[i].id, Vec3::Zero(), s.X.to_local(x + size * unit_vector(random)), true};
  }
  const Pose X_free = displaced(s.X, twist(random, size));
  build_rows(*s.problem, s.instrument, X_free, s.X, s.problem->x_free, some_coupling(), s.memory, 0.5e-3,
             *s.rows);
  for (int i = 0; i < s.rows->contacts; ++i) {
    const ContactRow& row = s.rows->row[i];
    const Vec3 x = sample_position(*s.problem, s.problem->x_free, row.sample);
    const Vec3 slip = row.frame.transpose() * (x - X_free.to_world(s.memory.entry[i].anchor));
    EXPECT_LT((row.delta_free - slip).tail<2>().norm(), 1e-3 * size);
    EXPECT_GT(slip.norm(), 0.01 * size);
  }
}

TEST(Rows, ShiftEqualsRebuildingWithAnotherFreePose) {
  for (const double friction : {0.0, 0.3}) {
    Scene s = pressed(7, friction);
    Random random(7);
    const Pose X_free = displaced(s.X, twist(random, 1e-5));
    const VecX unshifted = s.rows->q();
    shift_rows(*s.problem, s.X, X_free, s.memory, *s.rows);
    const VecX shifted = s.rows->q();
    build_rows(*s.problem, s.instrument, X_free, s.X, s.problem->x_free, some_coupling(), s.memory, 0.5e-3,
               *s.rows);
    EXPECT_LT((shifted - s.rows->q()).norm(), 1e-15);
    EXPECT_GT((shifted - unshifted).norm(), 1e-6);
  }
}

TEST(Rows, OnlySamplesFacingTheInstrumentWithinTheMargin) {
  Scene s = pressed(8, 0.0);
  for (int i = 0; i < s.rows->contacts; ++i) EXPECT_LT(s.rows->row[i].gap, 0.5e-3);
  for (int i = 1; i < s.rows->contacts; ++i) EXPECT_LT(s.rows->row[i - 1].id, s.rows->row[i].id);
  EXPECT_EQ(s.rows->dropped, 0);
  for (int k = 0; k < s.problem->samples; ++k) {  // wound the other way round: from inside
    PatchSample& sample = s.problem->sample[k];
    std::swap(sample.node[0], sample.node[1]);
    std::swap(sample.weight[0], sample.weight[1]);
  }
  build_rows(*s.problem, s.instrument, s.X, s.X, s.problem->x_free, no_coupling, s.memory, 0.5e-3, *s.rows);
  EXPECT_EQ(s.rows->contacts, 0);
}

TEST(Rows, BeyondCapacityTheDeepestHalfIsKeptAndTheRestCounted) {
  Random random(9);
  SheetSettings settings;
  settings.per_triangle = 5;
  const auto problem = sheet_problem(random, settings);
  const Instrument instrument = sphere_instrument(2e-3);
  const Pose X{Vec3(0.3e-3, 0.1e-3, 1.0e-3), Quat::Identity()};
  const auto rows = std::make_unique<ContactRows>();
  build_rows(*problem, instrument, X, X, problem->x_free, no_coupling, {}, 1e-3, *rows);
  std::vector<double> gaps;
  for (int k = 0; k < problem->samples; ++k)
    gaps.push_back(gap_at(instrument, X, sample_position(*problem, problem->x_free, k)).distance);
  std::sort(gaps.begin(), gaps.end());
  const auto candidates = std::count_if(gaps.begin(), gaps.end(), [](double g) { return g < 1e-3; });
  ASSERT_GT(candidates, max_contacts);
  EXPECT_EQ(rows->contacts, max_contacts);
  const auto overlapping = std::count_if(gaps.begin(), gaps.end(), [](double g) { return g < 0; });
  ASSERT_GT(overlapping, max_contacts);
  int kept_overlapping = 0, deepest = 0;
  for (int i = 0; i < rows->contacts; ++i) {
    kept_overlapping += rows->row[i].gap < 0;
    deepest += rows->row[i].gap <= gaps[max_contacts / 2 - 1];
  }
  EXPECT_EQ(deepest, max_contacts / 2);
  EXPECT_EQ(rows->dropped, overlapping - kept_overlapping);
}

TEST(Rows, DisplacedPatchIsFreePlusComplianceTimesForces) {
  const Scene s = pressed(10, 0.3);
  Random random(10);
  VecX lambda(s.rows->rows());
  for (double& l : lambda) l = normal(random);
  const VecX u = s.problem->C() * dense_H(*s.problem, *s.rows).transpose() * lambda;
  PatchPositions x, from_memory;
  displaced_patch(*s.problem, *s.rows, {lambda.data(), static_cast<std::size_t>(lambda.size())}, x);
  ContactMemory memory;
  memory.count = s.rows->contacts;
  for (int i = 0; i < memory.count; ++i) {
    const ContactRow& row = s.rows->row[i];
    memory.entry[i] = {row.id, row.frame * lambda.segment<3>(3 * i), Vec3::Zero(), false};
  }
  displaced_patch(*s.problem, memory, from_memory);
  for (int a = 0; a < s.problem->nodes; ++a) {
    EXPECT_LT((x[a] - s.problem->x_free[a] - u.segment<3>(3 * a)).norm(), 1e-13 * u.norm());
    EXPECT_LT((x[a] - from_memory[a]).norm(), 1e-13 * u.norm());
  }
}

// Without it the patch would be drawn where it springs to, through the instrument.
TEST(Rows, DisplacedPatchStaysWhereItIsWhenAForceIsForgotten) {
  const Scene s = pressed(10, 0.3);
  for (int a = 0; a < s.problem->nodes; ++a) s.problem->x_now[a] = Vec3(a, 0, 1);
  const std::uint64_t gone = s.problem->sample[s.problem->samples - 1].id + 1;
  ContactMemory memory;
  memory.count = 2;
  memory.entry[0] = {s.problem->sample[0].id, Vec3(0, 0, -1e-3), Vec3::Zero(), false};
  PatchPositions x;
  for (const double force : {0.0, 1e-3}) {
    memory.entry[1] = {gone, Vec3(0, 0, -force), Vec3::Zero(), false};
    displaced_patch(*s.problem, memory, x);
    for (int a = 0; a < s.problem->nodes; ++a) EXPECT_EQ(x[a] == s.problem->x_now[a], force > 0);
  }
}

// Whatever order it is asked in, and of what it does not have.
TEST(Memory, AskedInOrderOrNotItFindsTheSame) {
  Random random(7);
  ContactMemory memory;
  for (std::uint64_t id = 10; id < 40; id += 3)
    for (int instrument = 0; instrument < 2; ++instrument)
      for (int primitive = static_cast<int>(id) % 2; primitive < 3; primitive += 2)
        memory.entry[memory.count++] = {id, Vec3(1, 0, 0), Vec3::Zero(), false, primitive, instrument};
  int found = 0;
  for (const bool rising : {true, false}) {
    int from = 0;
    for (int k = 0; k < 45 * 2 * 3; ++k) {
      const int at = rising ? k : static_cast<int>(uniform(random, 0, 45 * 2 * 3));
      const auto id = static_cast<std::uint64_t>(at / 6);
      const int instrument = at / 3 % 2, primitive = at % 3;
      const ContactMemory::Entry* const e = memory.find(id, instrument, primitive, from);
      EXPECT_EQ(e, memory.find(id, instrument, primitive)) << rising << " " << at;
      found += rising && e != nullptr;
    }
  }
  EXPECT_EQ(found, memory.count);
}

}  // namespace
}  // namespace hapticd
