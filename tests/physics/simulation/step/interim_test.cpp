// A body's condensed system without elements that just went: the same as condensing afresh without them.
#include "physics/simulation/step/interim.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "physics/simulation/step/predicted_linearisation.h"
#include "tests/physics/simulation/step/soft_block.h"

namespace hapticd {
namespace {

using namespace soft_block_bench;

// Nodes above the middle that have an element left, then whatever else went.
std::vector<int> nodes_of_interest(const Body& body, std::span<const int> gone, int& kept) {
  std::vector<int> nodes;
  for (int n = 0; n < body.model.node_count(); ++n)
    if (body.rest()[n].z() > 0.012 && body.state.live_tets_of_node[n] > 0) nodes.push_back(n);
  kept = static_cast<int>(nodes.size());
  for (const int t : gone)
    for (const int n : body.model.mesh.tets[t])
      if (std::count(nodes.begin(), nodes.end(), n) == 0) nodes.push_back(n);
  return nodes;
}

struct Case {
  bool ahead;
  ComplianceMethod method;
  double density;
  double tolerance;
};

class Without : public testing::TestWithParam<Case> {};

TEST_P(Without, IsTheSystemCondensedAfreshWithoutThem) {
  const auto [ahead, method, density, tolerance] = GetParam();
  Body body(soft_block(4, ahead, density), h, gravity, method),
      other(soft_block(4, ahead, density), h, gravity);
  disturb(body);
  disturb(other);
  std::vector<int> all(body.model.node_count());
  for (std::size_t n = 0; n < all.size(); ++n) all[n] = static_cast<int>(n);
  body.compliance->move_zone(all);
  other.compliance->move_zone(all);
  const auto linearise = [&](Body& b) {
    if (ahead) {
      for (int n = 0; n < b.model.node_count(); ++n)
        b.free.dx.segment<3>(3 * n) =
            b.model.fixed[n] ? Vec3(Vec3::Zero()) : Vec3(1e-4 * Vec3(1, -2, 3) * b.rest()[n].z() / 0.02);
      linearise_ahead(b, h);
    } else {
      b.compliance->update(b.state);
      compute_free_motion(b, h);
    }
  };
  linearise(body);
  const std::vector<int> tets = corner_and_neighbour(body);
  ASSERT_EQ(take_out(body, tets).size(), tets.size());
  ASSERT_EQ(body.state.live_tets_of_node[highest_node(body)], 0);
  int kept = 0;
  const std::vector<int> nodes = nodes_of_interest(body, tets, kept);
  Condensed interim;
  ASSERT_TRUE(woodbury_downdate(body, tets, {}, ahead ? Linearised::ahead : Linearised::here, h, nodes, kept,
                                VecX::Zero(3 * nodes.size()), 0, interim));

  remove_from(other, tets);
  linearise(other);
  MatX C(3 * kept, 3 * kept);
  other.compliance->patch(std::span(nodes).first(kept), C);
  VecX dx(3 * kept);
  for (int i = 0; i < kept; ++i) dx.segment<3>(3 * i) = other.free.dx.segment<3>(3 * nodes[i]);
  EXPECT_LT((interim.C - C).norm(), tolerance * C.norm());
  EXPECT_LT((interim.dx_free - dx).norm(), tolerance * dx.norm());
}

// The last: next to no mass, and what a nearly static piece amplifies.
INSTANTIATE_TEST_SUITE_P(Bodies, Without,
                         testing::Values(Case{false, ComplianceMethod::exact, 1000, 1e-10},
                                         Case{true, ComplianceMethod::exact, 1000, 1e-10},
                                         Case{false, ComplianceMethod::zone, 1000, 1e-10},
                                         Case{true, ComplianceMethod::zone, 1000, 1e-10},
                                         Case{true, ComplianceMethod::exact, 1e-3, 1e-8}));

// A body that loses nothing while another does: the problem that its own factor gives.
TEST(Interim, OfABodyThatLosesNothingIsItsPlainProblem) {
  for (const auto method : {ComplianceMethod::exact, ComplianceMethod::zone})
    for (const bool ahead : {false, true}) {
      Body body(soft_block(4, ahead), h, gravity, method);
      disturb(body);
      std::vector<int> all(body.model.node_count());
      for (std::size_t n = 0; n < all.size(); ++n) all[n] = static_cast<int>(n);
      body.compliance->move_zone(all);
      body.compliance->update(body.state);
      compute_free_motion(body, h);
      finish_free_motion(body, nullptr);
      if (ahead) linearise_ahead(body, h);
      int kept = 0;
      const std::vector<int> nodes = nodes_of_interest(body, {}, kept);
      ASSERT_EQ(kept, static_cast<int>(nodes.size()));
      know_free_motion(body, nodes);
      VecX force(3 * kept);
      for (int i = 0; i < 3 * kept; ++i) force[i] = 1e-3 * std::sin(i);
      Condensed interim;
      ASSERT_TRUE(woodbury_downdate(body, {}, {}, ahead ? Linearised::ahead : Linearised::here, h, nodes,
                                    kept, force, 0, interim));
      MatX C(3 * kept, 3 * kept);
      body.compliance->patch(nodes, C);
      VecX dx(3 * kept);
      for (int i = 0; i < kept; ++i) dx.segment<3>(3 * i) = body.free.dx.segment<3>(3 * nodes[i]);
      EXPECT_LT((interim.C - C).norm(), 1e-14 * C.norm());
      EXPECT_LT((interim.dx_free - dx).norm(), 1e-14 * dx.norm());
      EXPECT_LT((interim.dx_pressed - dx - C * force).norm(), 1e-14 * interim.dx_pressed.norm());
      EXPECT_TRUE(interim.changed.empty());
    }
}

TEST(Interim, OfNodesThatTheZoneDoesNotCoverThereIsNone) {
  Body body(soft_block(4, false), h, gravity);
  const std::vector<int> zone = {highest_node(body)};
  body.compliance->move_zone(zone);
  body.compliance->update(body.state);
  compute_free_motion(body, h);
  const std::vector<int> tets = corner_and_neighbour(body);
  take_out(body, tets);
  int kept = 0;
  const std::vector<int> nodes = nodes_of_interest(body, tets, kept);
  Condensed interim;
  EXPECT_FALSE(woodbury_downdate(body, tets, {}, Linearised::here, h, nodes, kept,
                                 VecX::Zero(3 * nodes.size()), 0, interim));
}

// Sheared by `angle` above where it is, foreseen.
void predict_linearisation_at(Body& body, double angle) {
  for (int n = 0; n < body.model.node_count(); ++n)
    body.free.dx.segment<3>(3 * n) =
        body.model.fixed[n] ? Vec3(Vec3::Zero()) : Vec3(angle * body.rest()[n].z() * Vec3(1, 0.3, -0.2));
  linearise_ahead(body, h);
}

std::vector<int> all_nodes(const Body& body) {
  std::vector<int> nodes(body.model.node_count());
  for (std::size_t n = 0; n < nodes.size(); ++n) nodes[n] = static_cast<int>(n);
  return nodes;
}

// With rotations held a body is linear, whatever it was linearised at: all that counts is the rotations.
TEST(StaleRotation, AllOfThemAreABodyLinearisedThere) {
  Body body(soft_block(3, true), h, gravity), other(soft_block(3, true), h, gravity);
  const std::vector<int> nodes = all_nodes(body);
  for (Body* b : {&body, &other}) {
    disturb(*b);
    b->compliance->move_zone(nodes);
  }
  predict_linearisation_at(body, 0.05);
  predict_linearisation_at(other, 0.4);
  std::vector<StaleRotation> stale;
  for (int t = 0; t < body.model.tet_count(); ++t) stale.push_back({t, other.state.rotation[t]});
  const int count = static_cast<int>(nodes.size());
  Condensed condensed;
  ASSERT_TRUE(woodbury_downdate(body, {}, stale, Linearised::ahead, h, nodes, count, VecX::Zero(3 * count), 0,
                                condensed));
  MatX C(3 * count, 3 * count);
  other.compliance->patch(nodes, C);
  EXPECT_LT((condensed.C - C).norm(), 1e-9 * C.norm());
  EXPECT_LT((condensed.dx_free - other.free.dx).norm(), 1e-9 * other.free.dx.norm());
  EXPECT_GT((body.free.dx - other.free.dx).norm(), 1e-3 * other.free.dx.norm()) << "it matters";

  // … and forces on the body as it was do to it what the change does.
  VecX f(3 * count), moved(3 * count);
  for (Eigen::Index i = 0; i < f.size(); ++i) f[i] = 1e-3 * std::sin(7.0 * static_cast<double>(i));
  VecX both = f;
  const VecX change = force_of_change(condensed, f);
  for (std::size_t g = 0; g < condensed.changed.size(); ++g)
    both.segment<3>(3 * condensed.changed[g]) += change.segment<3>(static_cast<Eigen::Index>(3 * g));
  body.compliance->apply(both, moved);
  const VecX expected = condensed.dx_free + condensed.C * f;
  EXPECT_LT((body.free.dx + moved - expected).norm(), 1e-9 * expected.norm());
}

TEST(StaleRotation, ARigidTurnIsFoundAndRestIsNot) {
  Body body(soft_block(3, true), h, gravity);
  body.compliance->move_zone(all_nodes(body));
  body.compliance->update(body.state);
  VecX dx = VecX::Zero(3 * body.model.node_count());
  EXPECT_TRUE(stale_rotations(body, dx, 1e-12).empty());
  const Mat3 turn = Eigen::AngleAxisd(0.3, Vec3(1, 2, 2).normalized()).matrix();
  for (int n = 0; n < body.model.node_count(); ++n)
    if (!body.model.fixed[n]) dx.segment<3>(3 * n) = turn * body.rest()[n] - body.rest()[n];
  int whole = 0, nodes = 0;
  std::vector<int> named(body.state.x.size(), 0);
  for (const StaleRotation& t : stale_rotations(body, dx, 1e-12)) {
    const Tet& tet = body.model.mesh.tets[t.tet];
    for (const int n : tet) nodes += std::exchange(named[n], 1) == 0;
    if (std::any_of(tet.begin(), tet.end(), [&](int n) { return body.model.fixed[n] != 0; })) continue;
    ++whole;
    EXPECT_LT((t.R - turn).norm(), 1e-9);
  }
  EXPECT_GT(whole, 0);
  EXPECT_LE(nodes, most_stale_nodes);
}

}  // namespace
}  // namespace hapticd
