// Tissue that is condensed to its boundary, against the whole body and against dense inverses.
#include "physics/compliance/condense_far.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "physics/simulation/world.h"
#include "physics/tissue/fragments.h"
#include "physics/tissue/tissue_parts.h"
#include "tests/physics/compliance/oracle.h"
#include "tests/support/bodies.h"

namespace hapticd {
namespace {

using oracle::apply_error;
using oracle::inverse;
using oracle::patch_error;
using oracle::relative;

const NearRegion near_top{Vec3(oracle::size.x() / 2, oracle::size.y() / 2, oracle::size.z()), 3e-3};

// Held at its bottom; below, a stretched region and springs, which are far.
TissueModel tissue(int cells) {
  TissueModel model = oracle::box(cells);
  model.gravity = Vec3(1, 2, -9.81);
  TissueRegion region{{}, {9000, 0.3, 1200}, Vec3(1.1, 0.95, 1.02)};
  std::vector<NodeSpring> springs(model.mesh.nodes.size());
  for (int t = 0; t < model.tet_count(); ++t)
    if (model.mesh.nodes[model.mesh.tets[t][0]].z() < 0.2 * oracle::size.z()) region.tets.push_back(t);
  set_region(model, region);
  for (int n = 0; n < model.node_count(); ++n)
    if (const Vec3& x = model.mesh.nodes[n]; x.x() < 1e-9) springs[n] = {20, x + Vec3(1e-4, 0, -2e-4)};
  set_springs(model, springs);
  return model;
}

// Half of the box, condensed beyond 3 mm from the middle of its top.
struct Near {
  explicit Near(TissueModel of) : model(std::move(of)), state(rest_state(model)) {
    condense_far(model, state, near_top);
  }
  std::vector<int> nodes() const {
    std::vector<int> of;
    for (int n = 0; n < model.node_count(); ++n)
      if (oracle::in_system(model, state, n)) of.push_back(n);
    return of;
  }
  TissueModel model;
  TissueState state;
};

MatX rows_and_columns(const MatX& C, const std::vector<int>& nodes) {
  const std::vector<int> index = oracle::dofs_of(nodes);
  return C(index, index);
}

// The theorem: of a linear static body the near nodes' compliance is the whole body's, and so is where its
// weight and its tension bring them.
TEST(CondenseFar, LinearStaticTissueIsExact) {
  TissueModel whole = tissue(6);
  whole.dynamic = whole.corotational = false;
  const TissueState state = rest_state(whole);
  Near near(whole);
  const std::vector<int> nodes = near.nodes();
  ASSERT_TRUE(near.model.condensed);
  ASSERT_GT(near.model.condensed->node.size(), 20u);
  ASSERT_LT(nodes.size(), 0.6 * whole.node_count());
  const MatX C = inverse(whole, state), C_near = inverse(near.model, near.state);
  EXPECT_LT(relative(rows_and_columns(C_near, nodes), rows_and_columns(C, nodes)), 1e-9);

  const auto moved = [](const TissueModel& model, const TissueState& at, const MatX& inverse_of) {
    VecX inner(3 * model.node_count()), outer(inner.size());
    internal_forces(model, at, inner);
    external_forces(model, at, outer);
    return VecX(inverse_of * (inner + outer));
  };
  const std::vector<int> index = oracle::dofs_of(nodes);
  const VecX expected = moved(whole, state, C)(index);
  ASSERT_GT(expected.norm(), 1e-5);
  EXPECT_LT(relative(moved(near.model, near.state, C_near)(index), expected), 1e-9);
}

TEST(CondenseFar, ForceIsTheNegativeGradientOfTheEnergy) {
  Near near(tissue(4));
  near.state.x = oracle::deformed(near.model, 3).x;
  update_rotations(near.model, near.state);
  VecX f(3 * near.model.node_count());
  internal_forces(near.model, near.state, f);
  double worst = 0;
  for (const int n : near.nodes())
    for (int c = 0; c < 3; ++c) {
      constexpr double step = 1e-8;
      double energy[2];
      for (const int side : {0, 1}) {
        TissueState moved = near.state;
        moved.x[n][c] += side ? step : -step;
        update_rotations(near.model, moved);
        energy[side] = elastic_energy(near.model, moved);
      }
      worst = std::max(worst, std::abs((energy[1] - energy[0]) / (2 * step) + f[3 * n + c]));
    }
  EXPECT_LT(worst, 1e-6 * f.norm());
}

TEST(CondenseFar, EveryWayToTheSystemMatrixIsTheSame) {
  Near near(tissue(4));
  VecX x = VecX::Zero(3 * near.model.node_count());
  const VecX load = oracle::load(x.size());
  for (const int n : near.nodes()) x.segment<3>(3 * n) = load.segment<3>(3 * n);
  const VecX expected = assemble_system_matrix(near.model, near.state, oracle::h) * x;
  SystemMatrix blocks(near.model, node_graph(near.model), oracle::h);
  blocks.assemble(near.state);
  EXPECT_LT((blocks.multiply(x) - expected).norm(), 1e-12 * expected.norm());
  EXPECT_LT((multiply_system_matrix(near.model, near.state, oracle::h, x) - expected).norm(),
            1e-12 * expected.norm());
}

// No node of the far part's own is heavier than what there is.
TEST(CondenseFar, MassIsNotMoreThanTheTissues) {
  const TissueModel whole = tissue(6);
  const TissueState state = rest_state(whole);
  const Near near(whole);
  double all = 0, simulated = 0, boundary = 0;
  for (const double m : state.mass) all += m;
  for (const int n : near.nodes()) simulated += near.state.mass[n];
  for (const double m : near.model.condensed->mass) boundary += m;
  EXPECT_LT(simulated, all);
  EXPECT_GT(boundary, 0.05 * all);
}

class CondensedWithEveryMethod : public testing::TestWithParam<ComplianceMethod> {};

TEST_P(CondensedWithEveryMethod, AgreesWithAFreshInverseAfterRemovals) {
  Near near(tissue(5));
  const auto compliance = make_compliance(GetParam(), near.model, oracle::h);
  std::vector<int> zone;
  for (const int n : oracle::nearest(near.model, near_top.centre, 24))
    if (oracle::in_system(near.model, near.state, n)) zone.push_back(n);
  compliance->move_zone(zone);
  compliance->update(near.state);
  EXPECT_LT(apply_error(*compliance, inverse(near.model, near.state)), 1e-8);
  int removed = 0;
  for (int t = near.model.tet_count() - 1; t >= 0 && removed < 24; --t) {
    if (!near.state.alive[t]) continue;
    const std::array<int, 1> gone = {t};
    remove_tets(near.model, near.state, gone);
    compliance->remove(near.state, gone);
    compliance->update(near.state);
    if (++removed % 6 != 0) continue;
    const MatX C = inverse(near.model, near.state);
    EXPECT_LT(patch_error(*compliance, C, zone), 1e-8) << removed;
    EXPECT_LT(apply_error(*compliance, C), 1e-8) << removed;
  }
}

std::string method_name(const testing::TestParamInfo<ComplianceMethod>& method) {
  static constexpr const char* names[] = {"exact", "zone", "lazy", "updown", "dense"};
  return names[static_cast<int>(method.param)];
}
INSTANTIATE_TEST_SUITE_P(, CondensedWithEveryMethod,
                         testing::Values(ComplianceMethod::exact, ComplianceMethod::zone,
                                         ComplianceMethod::lazy, ComplianceMethod::updown,
                                         ComplianceMethod::dense),
                         method_name);

// Solves in halves, and a reference factor that is made elsewhere while tissue goes, in the body's numbers.
TEST(CondenseFar, AReferenceFactorServesTheWholeBodysNumbers) {
  Near near(tissue(5));
  const auto compliance = make_reference_compliance(ComplianceMethod::zone, near.model, oracle::h);
  std::vector<int> zone;
  for (const int n : oracle::nearest(near.model, near_top.centre, 24))
    if (oracle::in_system(near.model, near.state, n)) zone.push_back(n);
  compliance->move_zone(zone);
  compliance->update(near.state);
  const auto reference = [&] { return compliance->snapshot_reference(near.state); };
  auto made = reference();
  std::vector<int> gone;
  for (int t = near.model.tet_count() - 1; t >= 0 && gone.size() < 6; --t)
    if (near.state.alive[t]) gone.push_back(t);
  remove_tets(near.model, near.state, gone);
  compliance->remove(near.state, gone);
  made->make();
  compliance->adopt_reference(std::move(made), near.state);
  compliance->update(near.state);
  const MatX C = inverse(near.model, near.state);
  EXPECT_LT(apply_error(*compliance, C), 1e-8);

  // Far nodes are in no solve: nothing is to be known of them.
  std::vector<int> asked = zone;
  for (int n = 0; n < near.model.node_count(); ++n)
    if (near.model.condensed->place_of(n) < 0 && near.model.fixed[n]) asked.push_back(n);
  ASSERT_GT(asked.size(), zone.size() + 10);
  EXPECT_TRUE(compliance->zone_covers(asked));
  EXPECT_TRUE(compliance->forward_covers(asked));
  const std::vector<int> unknown = {near.model.node_count()};
  EXPECT_THROW(compliance->move_zone(unknown), std::invalid_argument);
  MatX block(3 * asked.size(), 3 * asked.size());
  compliance->patch(asked, block);
  EXPECT_LT(relative(block, rows_and_columns(C, asked)), 1e-8);

  const VecX b = oracle::load(C.rows());
  VecX f = VecX::Zero(b.size()), y(b.size());
  for (const int n : zone) f.segment<3>(3 * n) = Vec3(1, -2, 0.5);
  ASSERT_EQ(compliance->start_solve(b, y), Solved::forward);
  for (const int n : zone) EXPECT_LT((y - C * b).segment<3>(3 * n).norm(), 1e-8 * (C * b).norm());
  compliance->finish_solve(f, y);
  EXPECT_LT(relative(y, C * (b + f)), 1e-8);
  compliance->apply_in_zone(f, y);
  for (const int n : zone) EXPECT_LT((y - C * f).segment<3>(3 * n).norm(), 1e-8 * (C * f).norm());
}

// A part of the far tissue that nothing but near tissue holds would have no stiffness of its own: the free
// end of a bar that is near in its middle.
TEST(CondenseFar, WhatIsNotHeldStaysNear) {
  const TetMesh mesh = box_mesh({30e-3, 6e-3, 6e-3}, 15, 3, 3);
  std::vector<int> left;
  for (std::size_t n = 0; n < mesh.nodes.size(); ++n)
    if (mesh.nodes[n].x() < 1e-9) left.push_back(static_cast<int>(n));
  TissueModel model = make_tissue_model(mesh, {3000, 0.3, 1000}, left, Vec3::Zero());
  TissueState state = rest_state(model);
  condense_far(model, state, {Vec3(15e-3, 3e-3, 3e-3), 6e-3});
  ASSERT_TRUE(model.condensed);
  for (int t = 0; t < model.tet_count(); ++t) {
    double x = 0;
    for (const int n : mesh.tets[t]) x += 0.25 * mesh.nodes[n].x();
    EXPECT_TRUE(x < 15e-3 || state.alive[t]) << t;
    EXPECT_TRUE(x > 8e-3 || !state.alive[t]) << t;
  }
}

// What is condensed once is so in every state at rest.
TEST(CondenseFar, AtRestIsAsItWasCondensed) {
  const Near near(tissue(4));
  const TissueState again = rest_state(near.model);
  EXPECT_EQ(again.alive, near.state.alive);
  EXPECT_EQ(again.mass, near.state.mass);
  EXPECT_EQ(again.live_tets_of_node, near.state.live_tets_of_node);
}

// What is cut in two near the boundary stays one piece: each half pulls at the other through what is
// condensed.
TEST(CondenseFar, WhatMeetsCondensedTissueIsOnePiece) {
  Near near(tissue(6));
  std::vector<int> middle;
  for (const int t : near.model.condensed->near_tet) {
    double x = 0;
    for (const int n : near.model.mesh.tets[t]) x += 0.25 * near.model.mesh.nodes[n].x();
    if (std::abs(x - near_top.centre.x()) < 1.2e-3) middle.push_back(t);
  }
  remove_tets(near.model, near.state, middle);
  TissueModel alone = near.model;
  alone.condensed.reset();
  ASSERT_GT(find_pieces(alone, near.state).count(), 1);
  const Pieces pieces = find_pieces(near.model, near.state);
  EXPECT_EQ(pieces.count(), 1);
  EXPECT_EQ(pieces.held.front(), 1);
  for (const int n : near.model.condensed->node) EXPECT_EQ(pieces.of_node[n], 0);
}

TEST(CondenseFar, NothingFarChangesNothingAndNothingNearIsRefused) {
  TissueModel model = oracle::box(3);
  TissueState state = rest_state(model);
  condense_far(model, state, {Vec3::Zero(), 1});
  EXPECT_FALSE(model.condensed);
  EXPECT_EQ(state.mass, rest_state(oracle::box(3)).mass);
  EXPECT_THROW(condense_far(model, state, {Vec3(1, 1, 1), 1e-3}), std::invalid_argument);
}

BodySettings held_block(bool condensed) {
  BodySettings settings = block("block", {0.02, 0.02, 0.012}, {10, 10, 6}, {5000, 0.4, 1000, 5, 2e-3});
  for (std::size_t n = 0; n < settings.mesh.nodes.size(); ++n)
    if (settings.mesh.nodes[n].z() < 1e-9) settings.fixed_nodes.push_back(static_cast<int>(n));
  settings.removable = true;
  if (condensed) settings.near = NearRegion{Vec3(0.01, 0.01, 0.012), 6.5e-3};
  return settings;
}

WorldSettings pressed_world(ComplianceMethod method) {
  WorldSettings settings = contact_world({});
  settings.compliance = method;
  settings.alarm_distance = 2e-3;
  settings.sample_spacing = 1e-3;
  settings.coupling[0] = {500, 0.05, 0};
  return settings;
}

// Pressed, moved and let go at once, as much of it as the tip reaches being condensed: the force of each
// step.
TEST(CondenseFar, APressedBlockAnswersAsTheWholeOne) {
  for (const ComplianceMethod method : {ComplianceMethod::exact, ComplianceMethod::zone}) {
    World whole({held_block(false)}, ball(2e-3), pressed_world(method)),
        near({held_block(true)}, ball(2e-3), pressed_world(method));
    ASSERT_TRUE(near.bodies()[0].model.condensed);
    const auto problem = std::make_unique<CondensedProblem>();
    double peak = 0, off = 0;
    for (int k = 0; k < 60; ++k) {
      const double way = std::min(1.0, k / 15.0), deep = k < 45 ? 1e-3 * way : -2e-3;
      const InstrumentSample tip = at(Vec3(0.01 + 5e-4 * way, 0.01, 0.014 - deep));
      const auto force = [&](World& world) {
        const StepReport report = world.step([&] { return tip; }, *problem);
        EXPECT_EQ(report.condensed_nodes, 0);
        return Vec3(report.contact.wrench[0].head<3>());
      };
      const Vec3 expected = force(whole);
      peak = std::max(peak, expected.norm());
      off = std::max(off, (force(near) - expected).norm());
    }
    EXPECT_GT(peak, 1e-3);
    EXPECT_LT(off, 0.02 * peak);
  }
}

// The tip takes what is near down to the boundary: nodes that condensed tissue alone holds are left, and
// rest.
TEST(CondenseFar, AllThatIsNearMayGo) {
  WorldSettings settings = pressed_world(ComplianceMethod::zone);
  settings.removal[0] = {5000, 5e-4, 1e-3, 5000};
  World world({held_block(true)}, ball(2e-3), settings);
  const auto problem = std::make_unique<CondensedProblem>();
  const Body& body = world.bodies()[0];
  const auto left = [&] { return std::count(body.state.alive.begin(), body.state.alive.end(), 1); };
  const auto before = left();
  for (int k = 0; k < 200 && left() > 0; ++k) {
    const double a = 0.7 * k, r = 2e-4 * (k % 30), z = 0.0135 - 3.5e-5 * k;
    InstrumentSample tip = at(Vec3(0.01 + r * std::cos(a), 0.01 + r * std::sin(a), z));
    tip.phaco = tip.aspiration = true;
    const StepReport report = world.step([&] { return tip; }, *problem);
    ASSERT_TRUE(report.contact.wrench[0].allFinite()) << k;
    ASSERT_LT(fastest_node(body), 2) << k;
  }
  EXPECT_LT(left(), before / 2);
  for (int k = 0; k < 100; ++k) world.step([] { return InstrumentSamples(nobody()); }, *problem);
  EXPECT_LT(fastest_node(body), 1e-3);
}

// Beyond what is simulated the surface stands still: an instrument is stopped there, and takes nothing away.
TEST(CondenseFar, CondensedTissueIsRigidToAnInstrument) {
  World world({held_block(true)}, ball(2e-3), pressed_world(ComplianceMethod::zone));
  const auto problem = std::make_unique<CondensedProblem>();
  InstrumentSample tip = at(Vec3(0.0185, 0.0185, 0.0132));
  tip.phaco = true;
  StepReport report;
  for (int k = 0; k < 10; ++k) report = world.step([&] { return tip; }, *problem);
  const Body& body = world.bodies()[0];
  EXPECT_GT(report.condensed_nodes, 0);
  // The coupling alone gives way: 500 N/m times 0.8 mm.
  EXPECT_NEAR(report.contact.wrench[0].z(), 0.4, 0.02);
  EXPECT_EQ(body.state.removed, 0);
  EXPECT_EQ(body.state.x[static_cast<std::size_t>(body.model.mesh.nodes.size()) - 1], body.rest().back());
}

}  // namespace
}  // namespace hapticd
