// A zone is what is near the instrument: now, or along its way while the factor is in use.
#include "physics/simulation/step/zone_selection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>

#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double alarm_distance = 2e-3, radius = 2e-3;

class ZoneSelection : public testing::Test {
 protected:
  ZoneSelection() : body(settings(), 0.02, Vec3::Zero()) {
    Primitive tip;
    tip.shape = Shape::sphere;
    tip.radius = radius;
    instrument.primitives = {tip};
    X.p = Vec3(0.006, 0.01, 0.02 + radius);
  }
  static BodySettings settings() {
    BodySettings b{
        "block", true, box_mesh(Vec3(0.02, 0.02, 0.02), 10, 10, 10), {5000, 0.4, 1000, 5, 0.002}, {},
        0,       true};
    b.fixed_nodes = b.mesh.group("bottom")->nodes;
    return b;
  }
  ZoneRequest request(bool made_elsewhere) const {
    return {instrument, motion, X, alarm_distance, made_elsewhere, 2, {}, {}, {}};
  }
  double gap(int n) const { return (body.state.x[n] - X.p).norm() - radius; }

  Body body;
  Instrument instrument;
  InstrumentMotions motion;
  Pose X;
};

bool has(const std::vector<int>& nodes, int n) { return std::count(nodes.begin(), nodes.end(), n) > 0; }

// 1.25 alarm distances far; what a face has within one is needed.
TEST_F(ZoneSelection, ItIsWhatIsNearTheInstrument) {
  const Zone zone = select_zone(body, request(false));
  EXPECT_TRUE(zone.halo.empty());
  for (int n = 0; n < body.model.node_count(); ++n) {
    EXPECT_EQ(has(zone.nodes, n), gap(n) < 1.25 * alarm_distance) << gap(n);
    const bool on_top = body.rest()[n].z() > 0.02 - 1e-9;
    if (on_top && gap(n) < alarm_distance) {
      EXPECT_TRUE(has(zone.needed, n));
    }
  }
}

TEST_F(ZoneSelection, WhatIsNamedComesFirstAndContactsAreNeeded) {
  ZoneRequest r = request(false);
  const std::vector<int> first = {0, 1}, needed = {1}, contacts = {2};
  r.first = first;
  r.needed = needed;
  r.contact_nodes = contacts;
  r.X = {};
  const Zone zone = select_zone(body, r);
  EXPECT_EQ(zone.nodes, (std::vector<int>{0, 1, 2}));
  EXPECT_EQ(zone.needed, (std::vector<int>{1, 2}));
}

// The tip goes along x at 0.5 mm a step: a factor in the making is for where it will be.
TEST_F(ZoneSelection, OfAFactorMadeElsewhereItIsAheadOfTheInstrument) {
  const auto mean_x = [&](const Zone& zone) {
    double sum = 0;
    for (const int n : zone.nodes) sum += body.rest()[n].x();
    return sum / static_cast<double>(zone.nodes.size());
  };
  for (int i = -8; i <= 0; ++i) {
    const Pose there{X.p + 0.5e-3 * i * Vec3::UnitX(), X.q};
    motion.follow(InstrumentSample{there, true}, 0.02);
  }
  EXPECT_GT(mean_x(select_zone(body, request(true))), mean_x(select_zone(body, request(false))) + 1e-3);
}

// A rod sunk along the whole block would fill the zone; what the tip beside it needs is in it all the same.
TEST(ZoneOfTwo, HasWhatBothNeedWhereOneAloneWouldFillIt) {
  BodySettings settings{
      "block", true, box_mesh(Vec3(0.02, 0.02, 0.02), 16, 16, 16), {5000, 0.4, 1000, 5, 0.002}, {}, 0, true};
  const Body body(std::move(settings), 0.02, Vec3::Zero());
  Primitive rod, tip;
  rod.shape = Shape::capsule;
  rod.radius = radius;
  rod.half_length = 0.01;
  rod.placement.q = Quat(Eigen::AngleAxisd(0.5 * std::numbers::pi, Vec3::UnitY()));
  tip.shape = Shape::sphere;
  tip.radius = 1e-3;
  std::vector<Instrument> instruments(2);
  instruments[0].primitives = {rod};
  instruments[1].primitives = {tip};
  InstrumentMotions motion;
  const auto zone_of = [&](bool first, bool second) {
    InstrumentPoses X;
    X[0].p = Vec3(0.01, 0.004, 0.019);
    X[1].p = Vec3(0.01, 0.016, 0.021);
    X.present[0] = first;
    X.present[1] = second;
    return select_zone(body, {instruments, motion, X, alarm_distance, false, 2, {}, {}, {}});
  };
  const Zone one = zone_of(true, false), other = zone_of(false, true), both = zone_of(true, true);
  EXPECT_EQ(one.nodes.size(), 200u);
  ASSERT_GT(other.needed.size(), 10u);
  for (const int n : other.needed) {
    EXPECT_TRUE(has(both.nodes, n));
    EXPECT_TRUE(has(both.needed, n));
  }
  EXPECT_EQ(both.nodes.size(), 200u);
}

}  // namespace
}  // namespace hapticd
