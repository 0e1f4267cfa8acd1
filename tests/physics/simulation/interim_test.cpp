// A body's condensed system without elements that just went: the same as condensing afresh without them.
#include "physics/simulation/interim.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "physics/simulation/look_ahead.h"
#include "physics/simulation/world.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double h = 0.02;
const Vec3 gravity(0, 0, -9.81);

BodySettings soft_block(int n, bool corotational, double density = 1000) {
  BodySettings b{"block", true, box_mesh(Vec3(0.02, 0.02, 0.02), n, n, n), {5000, 0.4, density, 5, 0.002}, {},
                 0.2,     true};
  b.fixed_nodes = b.mesh.group("bottom")->nodes;
  b.corotational = corotational;
  return b;
}

// Sheared by a fifth and thrown sideways.
void disturb(Body& body) {
  for (int n = 0; n < body.model.node_count(); ++n) {
    if (body.model.fixed[n]) continue;
    body.state.x[n].x() += 0.2 * body.state.x[n].z();
    body.state.v[n] = Vec3(0.01, 10 * body.state.x[n].z(), -0.02);
  }
  update_rotations(body.model, body.state);
}

int highest_node(const Body& body) {
  int best = 0;
  for (int n = 0; n < body.model.node_count(); ++n)
    if (body.rest[n].sum() > body.rest[best].sum()) best = n;
  return best;
}

// Every tetrahedron at the free corner, which loses its node, and one that shares a face with one of them.
std::vector<int> corner_and_neighbour(const Body& body) {
  const int corner = highest_node(body);
  std::vector<int> tets;
  for (int t = 0; t < body.model.tet_count(); ++t)
    if (std::count(body.model.mesh.tets[t].begin(), body.model.mesh.tets[t].end(), corner) > 0)
      tets.push_back(t);
  for (int face = 0; face < 4; ++face)
    if (const int across = body.model.across[4 * tets[0] + face];
        across >= 0 && std::count(tets.begin(), tets.end(), across / 4) == 0) {
      tets.push_back(across / 4);
      break;
    }
  return tets;
}

// Nodes above the middle that have an element left, then whatever else went.
std::vector<int> nodes_of_interest(const Body& body, std::span<const int> gone, int& kept) {
  std::vector<int> nodes;
  for (int n = 0; n < body.model.node_count(); ++n)
    if (body.rest[n].z() > 0.012 && body.state.live_tets_of_node[n] > 0) nodes.push_back(n);
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
        b.dx_free.segment<3>(3 * n) =
            b.model.fixed[n] ? Vec3(Vec3::Zero()) : Vec3(1e-4 * Vec3(1, -2, 3) * b.rest[n].z() / 0.02);
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
  ASSERT_TRUE(condense_without(body, tets, ahead ? Linearised::ahead : Linearised::here, h, nodes, kept,
                               VecX::Zero(3 * nodes.size()), 0, interim));

  remove_from(other, tets);
  linearise(other);
  MatX C(3 * kept, 3 * kept);
  other.compliance->patch(std::span(nodes).first(kept), C);
  VecX dx(3 * kept);
  for (int i = 0; i < kept; ++i) dx.segment<3>(3 * i) = other.dx_free.segment<3>(3 * nodes[i]);
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
  EXPECT_FALSE(condense_without(body, tets, Linearised::here, h, nodes, kept, VecX::Zero(3 * nodes.size()), 0,
                                interim));
}

class PressedWorld : public testing::Test {
 protected:
  static InstrumentSample sample() { return {{Vec3(0.01, 0.01, 0.0215), Quat::Identity()}, true}; }

  static std::unique_ptr<World> world(bool corotational) {
    WorldSettings s;
    s.h = h;
    s.alarm_distance = 3e-3;
    s.sample_spacing = 1e-3;
    s.coupling = {500, 0.05, 0};
    s.lead = 0.9 * h;
    Instrument instrument;
    Primitive tip;
    tip.shape = Shape::sphere;
    tip.radius = 3e-3;
    instrument.primitives = {tip};
    std::vector<BodySettings> bodies;
    bodies.push_back(soft_block(6, corotational));
    bodies[0].friction = 0;
    return std::make_unique<World>(std::move(bodies), instrument, s);
  }

  // The six nearest to the tip.
  static std::vector<int> under_tip(const World& w) {
    const Body& body = w.bodies()[0];
    std::vector<std::pair<double, int>> all;
    for (int t = 0; t < body.model.tet_count(); ++t) {
      Vec3 c = Vec3::Zero();
      for (const int n : body.model.mesh.tets[t]) c += 0.25 * body.state.x[n];
      all.emplace_back((c - sample().pose.p).norm(), t);
    }
    std::sort(all.begin(), all.end());
    std::vector<int> nearest;
    for (int k = 0; k < 6; ++k) nearest.push_back(all[k].second);
    return nearest;
  }

  std::unique_ptr<CondensedProblem> first = std::make_unique<CondensedProblem>(),
                                    second = std::make_unique<CondensedProblem>();
  int published = 0;

  StepReport step(World& w) {
    return w.step([] { return sample(); }, *first,
                  [&]() -> CondensedProblem& {
                    ++published;
                    return *second;
                  });
  }
};

TEST_F(PressedWorld, PublishesAtOnceWhatItRemovesAndOnlyThen) {
  for (const bool corotational : {false, true}) {
    const auto w = world(corotational);
    published = 0;
    StepReport report;
    for (int i = 0; i < 40; ++i) report = step(*w);
    EXPECT_EQ(published, 0);
    EXPECT_FALSE(report.interim);
    const Vec3 before = report.contact.wrench.head<3>();
    EXPECT_GT(before.z(), 1e-3);
    const std::uint64_t last = first->step;

    const std::vector<int> gone = under_tip(*w);
    w->schedule_removal(0, gone);
    report = step(*w);
    EXPECT_EQ(published, 1);
    EXPECT_TRUE(report.interim);
    EXPECT_EQ(first->step, last + 1);
    EXPECT_EQ(second->step, last + 2);
    EXPECT_TRUE(first->topology_changed);
    EXPECT_FALSE(second->topology_changed) << "since the interim problem nothing went";
    ASSERT_GT(first->samples, 0);
    ASSERT_EQ(first->samples, second->samples);
    for (int k = 0; k < first->samples; ++k) {
      const auto tet =
          static_cast<int>(first->sample[k].id >> 14);  // a face is 4 tet + side, a sample 4096 of it
      EXPECT_EQ(std::count(gone.begin(), gone.end(), tet), 0);
      EXPECT_EQ(first->sample[k].id, second->sample[k].id);
    }
    // The step's own solve is of the same system at the same pose, linearised where the body is.
    ContactState state;
    const auto scratch = std::make_unique<ContactScratch>();
    ContactOptions options;
    options.linearisations = 8;
    options.margin = contact_margin * 3e-3;
    const Vec3 interim =
        solve_contact(*first, w->instrument(), sample().pose, h, options, state, *scratch).wrench.head<3>();
    const Vec3 own = report.contact.wrench.head<3>();
    EXPECT_LT((interim - own).norm(), (corotational ? 1e-2 : 1e-3) * own.norm());
    EXPECT_GT((before - own).norm(), 0.05 * before.norm()) << "it was worth an interim problem";
    EXPECT_FALSE(step(*w).interim);
  }
}

}  // namespace
}  // namespace hapticd
