// Two hands in one world: the tissue carries the push of one to the other, and nothing else does.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "physics/compliance/system_matrix.h"
#include "physics/simulation/world.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double side = 0.02, h = 0.02, radius = 2e-3;

Instrument ball(double r) {
  Primitive tip;
  tip.shape = Shape::sphere;
  tip.radius = r;
  Instrument instrument;
  instrument.primitives = {tip};
  return instrument;
}

BodySettings block(int cells, bool linear_and_static) {
  BodySettings b{
      "block", true, box_mesh(Vec3(side, side, side), cells, cells, cells), {5000, 0.4, 1000, 5, 0.002}, {},
      0.2,     true};
  b.fixed_nodes = b.mesh.group("bottom")->nodes;
  b.corotational = b.dynamic = !linear_and_static;
  if (linear_and_static) {
    b.friction = 0;
    b.removable = false;
  }
  return b;
}

WorldSettings settings(ComplianceMethod method) {
  WorldSettings s;
  s.h = h;
  s.alarm_distance = 2.5e-3;
  s.sample_spacing = 0.7e-3;
  s.compliance = method;
  s.instrument_friction = 0.1;
  for (int i = 0; i < 2; ++i) {
    s.coupling[i] = {500.0 - 200 * i, 0.05, 1e-3};
    s.removal[i] = {50, 5e-4, 1e-3, 50};
  }
  return s;
}

InstrumentSample at(const Vec3& p, bool phaco = false) { return {{p, Quat::Identity()}, true, phaco, phaco}; }

// From above, its lowest point so deep.
InstrumentSample pressing(double x, double y, double depth, bool phaco = false) {
  return at({x, y, side + radius - depth}, phaco);
}

InstrumentSamples two(const InstrumentSample& a, const InstrumentSample& b) {
  InstrumentSamples samples(a);
  samples[1] = b;
  return samples;
}

struct Hands {
  World world;
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();

  Hands(const BodySettings& body, std::vector<Instrument> tools, const WorldSettings& s)
      : world({body}, std::move(tools), s) {}
  StepReport step(const InstrumentSamples& samples) {
    for (ReferenceJob& job : world.wanted_references()) {
      job.reference->make();
      world.adopt(std::move(job));
    }
    return world.step([&] { return samples; }, *problem);
  }
};

// Node of the patch: whether the first instrument is the nearer one.
bool of_first(const CondensedProblem& problem, int n, const InstrumentSamples& X) {
  return (problem.x_now[n] - X[0].pose.p).norm() < (problem.x_now[n] - X[1].pose.p).norm();
}

// Betti: what a push of the first does at the second is what one of the second does at the first.
TEST(TwoHands, CrossComplianceIsReciprocal) {
  for (const ComplianceMethod method : {ComplianceMethod::exact, ComplianceMethod::zone}) {
    Hands hands(block(8, false), {ball(radius), ball(radius)}, settings(method));
    double largest = 0;
    for (int k = 0; k < 30; ++k) {
      const double depth = 0.1e-3 * std::min(k, 15);
      const InstrumentSamples X =
          two(pressing(7e-3, 10e-3, depth), pressing(12e-3 + 1e-4 * k, 9e-3, 0.7 * depth));
      hands.step(X);
      const CondensedProblem& problem = *hands.problem;
      ASSERT_GT(problem.nodes, 10);
      double worst = 0, size = 0;
      for (int a = 0; a < problem.nodes; ++a)
        for (int b = 0; b < problem.nodes; ++b) {
          if (!of_first(problem, a, X) || of_first(problem, b, X)) continue;
          const Mat3 ab = problem.C().block<3, 3>(3 * a, 3 * b), ba = problem.C().block<3, 3>(3 * b, 3 * a);
          worst = std::max(worst, (ab - ba.transpose()).norm());
          size = std::max(size, ab.norm());
        }
      ASSERT_GT(size, 0);
      largest = std::max(largest, worst / size);
    }
    EXPECT_LT(largest, 1e-9);
    std::printf("  %s: C_ij - C_jiT at most %.1e of C_ij\n",
                method == ComplianceMethod::zone ? "zone" : "exact", largest);
  }
}

// All contacts of a step, with friction and the two tools in one another.
TEST(TwoHands, ForcesAddUpToNothing) {
  Hands hands(block(6, false), {ball(radius), ball(radius)}, settings(ComplianceMethod::exact));
  bool touched = false;
  for (int k = 0; k < 40; ++k) {
    const double depth = 0.1e-3 * std::min(k, 15), apart = 4.4e-3 - 0.02e-3 * k;
    const StepReport report =
        hands.step(two(pressing(10e-3 - apart / 2, 10e-3, depth), pressing(10e-3 + apart / 2, 10e-3, depth)));
    const ContactScratch& scratch = hands.world.contact_scratch();
    const ContactRows& rows = scratch.rows;
    Vec3 on_tissue = Vec3::Zero();
    for (int i = 0; i < rows.contacts; ++i) {
      const Vec3 force = rows.row[i].frame * Vec3(Eigen::Map<const Vec3>(scratch.lambda.data() + 3 * i));
      if (rows.row[i].other < 0) on_tissue += force;
      touched = touched || (rows.row[i].other >= 0 && force.norm() > 1e-3);
    }
    const Vec3 one = report.contact.wrench[0].head<3>(), other = report.contact.wrench[1].head<3>();
    EXPECT_LE((one + other + on_tissue).norm(), 1e-12 * (one.norm() + other.norm()));
  }
  EXPECT_TRUE(touched);
}

// With a second instrument far from the tissue, resting or flying, taken out, or not in the world: cut and
// pressed, the first hand's tissue and force are the same bits.
TEST(TwoHands, OneAloneIsUnchangedBitForBit) {
  for (const ComplianceMethod method : {ComplianceMethod::exact, ComplianceMethod::zone}) {
    WorldSettings s = settings(method);
    s.lead = 0.9 * h;
    Hands alone(block(6, false), {ball(radius)}, s), absent(block(6, false), {ball(radius), ball(radius)}, s),
        resting(block(6, false), {ball(radius), ball(radius)}, s),
        flying(block(6, false), {ball(radius), ball(radius)}, s);
    int removed = 0;
    for (int k = 0; k < 50; ++k) {
      const InstrumentSample first = pressing(6e-3 + 0.1e-3 * k, 10e-3, 0.1e-3 * std::min(k, 15), k > 25);
      const StepReport expected = alone.step(first);
      removed += expected.removed;
      const auto same = [&](Hands& hands, const InstrumentSamples& X) {
        const StepReport report = hands.step(X);
        EXPECT_EQ(report.contact.wrench[0], expected.contact.wrench[0]) << k;
        EXPECT_EQ(hands.problem->nodes, alone.problem->nodes) << k;
        EXPECT_EQ(hands.problem->samples, alone.problem->samples) << k;
        const int size = alone.problem->nodes;
        for (int n = 0; n < size && n < hands.problem->nodes; ++n)
          EXPECT_EQ(hands.problem->x_free[n], alone.problem->x_free[n]);
        if (hands.problem->nodes == size) {
          EXPECT_EQ((hands.problem->C() - alone.problem->C()).norm(), 0) << k;
        }
      };
      same(absent, first);
      same(resting, two(first, at({0, 0, 1})));
      same(flying, two(first, at({1 + 5e-3 * k, 0, 1})));
    }
    EXPECT_GT(removed, 5);
  }
}

TEST(TwoHands, NeitherFeelsWhichOfThemIsTheFirst) {
  const WorldSettings s = settings(ComplianceMethod::exact);
  WorldSettings swapped = s;
  std::swap(swapped.coupling[0], swapped.coupling[1]);
  Hands one(block(6, false), {ball(radius), ball(0.8 * radius)}, s),
      other(block(6, false), {ball(0.8 * radius), ball(radius)}, swapped);
  for (int k = 0; k < 30; ++k) {
    const double depth = 0.1e-3 * std::min(k, 15);
    const InstrumentSample a = pressing(8e-3 + 0.05e-3 * k, 10e-3, depth);
    InstrumentSample b = pressing(13e-3, 10e-3, 0.7 * depth);
    b.pose.p.z() -= 0.2 * radius;
    const StepReport ab = one.step(two(a, b)), ba = other.step(two(b, a));
    for (int i = 0; i < 2; ++i)
      EXPECT_LE((ab.contact.wrench[i] - ba.contact.wrench[1 - i]).head<3>().norm(),
                1e-6 * ab.contact.wrench[i].head<3>().norm())
          << k;
  }
}

// Statics of a linear block: with the forces of both hands as loads, one dense solve with K gives where all
// nodes are; pressed samples lie on the instruments, which are where forces and couplings balance. The second
// hand's push moves the place that the first presses away from it, or towards it, and the first feels less,
// or more: the dense solve says which.
TEST(TwoHands, AreInTheEquilibriumOfOneLinearSolve) {
  WorldSettings s = settings(ComplianceMethod::exact);
  s.instrument_friction = 0;
  const BodySettings body = block(6, true);
  const InstrumentSample first = pressing(8.1e-3, 10.1e-3, 1e-3);
  const InstrumentSample beside = pressing(13.2e-3, 10.1e-3, 1e-3);
  const InstrumentSample from_the_side = at({side + radius - 1.5e-3, 10.1e-3, 13.1e-3});
  Hands alone(body, {ball(radius)}, s);
  Vec3 by_itself = Vec3::Zero();
  for (int k = 0; k < 20; ++k) by_itself = alone.step(first).contact.wrench[0].head<3>();
  ASSERT_GT(by_itself.z(), 1e-3);

  for (const InstrumentSample& second : {beside, from_the_side}) {
    Hands hands(body, {ball(radius), ball(radius)}, s);
    StepReport report;
    for (int k = 0; k < 40; ++k) report = hands.step(two(first, second));
    const Body& b = hands.world.bodies().front();
    const ContactScratch& scratch = hands.world.contact_scratch();
    const ContactRows& rows = scratch.rows;

    // Hᵀλ, of both hands and of the second alone.
    const Eigen::Index dofs = 3 * static_cast<Eigen::Index>(b.rest().size());
    VecX load = VecX::Zero(dofs), of_second = VecX::Zero(dofs);
    std::vector<int> body_node(static_cast<std::size_t>(hands.problem->nodes));
    for (int n = 0; n < hands.problem->nodes; ++n) {
      const auto away = [&](const Vec3& x) { return (x - hands.problem->x_now[n]).norm(); };
      body_node[static_cast<std::size_t>(n)] =
          static_cast<int>(std::min_element(b.state.x.begin(), b.state.x.end(),
                                            [&](const Vec3& x, const Vec3& y) { return away(x) < away(y); }) -
                           b.state.x.begin());
    }
    for (int i = 0; i < rows.contacts; ++i) {
      if (rows.row[i].other >= 0) continue;
      const PatchSample& sample = hands.problem->sample[rows.row[i].sample];
      const Vec3 force = scratch.lambda[i] * rows.row[i].frame.col(0);
      for (int c = 0; c < 3; ++c) {
        const Eigen::Index at_node = 3 * body_node[static_cast<std::size_t>(sample.node[c])];
        load.segment<3>(at_node) += sample.weight[c] * force;
        if (rows.row[i].instrument == 1) of_second.segment<3>(at_node) += sample.weight[c] * force;
      }
    }
    const Eigen::LLT<MatX> K(MatX(assemble_system_matrix(b.model, b.state, h)));
    const VecX u = K.solve(load), u_second = K.solve(of_second);
    double worst = 0, largest = 0;
    for (std::size_t n = 0; n < b.rest().size(); ++n) {
      const Vec3 moved = b.state.x[n] - b.rest()[n];
      worst = std::max(worst, (moved - u.segment<3>(3 * static_cast<Eigen::Index>(n))).norm());
      largest = std::max(largest, moved.norm());
    }
    ASSERT_GT(largest, 0.3e-3);
    EXPECT_LT(worst, 1e-6 * largest);

    for (int i = 0; i < 2; ++i) {
      const Vec3 yielded = two(first, second)[i].pose.p - report.contact.instrument[i].p;
      EXPECT_LT((report.contact.wrench[i].head<3>() + s.coupling[i].stiffness * yielded).norm(),
                1e-4 * report.contact.wrench[i].head<3>().norm());
    }
    for (int i = 0; i < rows.contacts; ++i) {
      if (rows.row[i].other >= 0 || !(scratch.lambda[i] > 0)) continue;
      const Vec3 x = sample_position(*hands.problem, scratch.x, rows.row[i].sample);
      EXPECT_LT(std::abs(gap_at(hands.world.instruments()[rows.row[i].instrument],
                                report.contact.instrument[rows.row[i].instrument], x)
                             .distance),
                1e-7);
    }

    // How the second's push moves the place that the first presses, along the first's force.
    const Vec3 force = report.contact.wrench[0].head<3>();
    double towards = 0;
    for (int i = 0; i < rows.contacts; ++i) {
      if (rows.row[i].other >= 0 || rows.row[i].instrument != 0) continue;
      const PatchSample& sample = hands.problem->sample[rows.row[i].sample];
      for (int c = 0; c < 3; ++c)
        towards +=
            scratch.lambda[i] * sample.weight[c] *
            u_second.segment<3>(3 * body_node[static_cast<std::size_t>(sample.node[c])]).dot(by_itself);
    }
    EXPECT_GT(std::abs(force.z() / by_itself.z() - 1), 0.005);
    EXPECT_EQ(force.z() > by_itself.z(), towards > 0);
    std::printf("  the first hand feels %.2f mN by itself, %.2f mN with the second\n", 1e3 * by_itself.z(),
                1e3 * force.z());
  }
}

// A hand that goes leaves no force, and the tissue comes back to what one alone makes of it.
TEST(TwoHands, WhoGoesLeavesNoForceBehind) {
  const WorldSettings s = settings(ComplianceMethod::exact);
  Hands hands(block(6, false), {ball(radius), ball(radius)}, s), alone(block(6, false), {ball(radius)}, s);
  const InstrumentSample first = pressing(8e-3, 10e-3, 1e-3), second = pressing(13e-3, 10e-3, 1e-3);
  for (int k = 0; k < 30; ++k) hands.step(two(first, second));
  InstrumentSample gone = second;
  gone.present = false;
  StepReport left, by_itself;
  for (int k = 0; k < 150; ++k) {
    left = hands.step(two(first, gone));
    EXPECT_TRUE(left.contact.wrench[1].isZero(0));
    by_itself = alone.step(first);
  }
  // Friction may have stuck elsewhere.
  EXPECT_NEAR(left.contact.wrench[0].z(), by_itself.contact.wrench[0].z(),
              0.02 * by_itself.contact.wrench[0].z());
  InstrumentSample above = second;
  above.pose.p.z() += 3e-3;
  EXPECT_TRUE(hands.step(two(first, above)).contact.wrench[1].isZero(0));
}

}  // namespace
}  // namespace hapticd
