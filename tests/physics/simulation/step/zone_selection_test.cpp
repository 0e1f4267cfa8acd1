// A zone is what is near the instrument: now, or along its way while the factor is in use.
#include "physics/simulation/step/zone_selection.h"

#include <gtest/gtest.h>

#include <algorithm>

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
    return {instrument, predictor, &X, alarm_distance, made_elsewhere, 2, {}, {}, {}};
  }
  double gap(int n) const { return (body.state.x[n] - X.p).norm() - radius; }

  Body body;
  Instrument instrument;
  PosePredictor predictor;
  Pose X;
};

bool has(const std::vector<int>& nodes, int n) { return std::count(nodes.begin(), nodes.end(), n) > 0; }

// 1.6 alarm distances far; what a face has within 1.15 is needed.
TEST_F(ZoneSelection, ItIsWhatIsNearTheInstrument) {
  const Zone zone = select_zone(body, request(false));
  EXPECT_TRUE(zone.halo.empty());
  for (int n = 0; n < body.model.node_count(); ++n) {
    EXPECT_EQ(has(zone.nodes, n), gap(n) < 1.6 * alarm_distance) << gap(n);
    const bool on_top = body.rest[n].z() > 0.02 - 1e-9;
    if (on_top && gap(n) < 1.15 * alarm_distance) {
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
  r.X = nullptr;
  const Zone zone = select_zone(body, r);
  EXPECT_EQ(zone.nodes, (std::vector<int>{0, 1, 2}));
  EXPECT_EQ(zone.needed, (std::vector<int>{1, 2}));
}

// The tip goes along x at 0.5 mm a step: a factor in the making is for where it will be.
TEST_F(ZoneSelection, OfAFactorMadeElsewhereItIsAheadOfTheInstrument) {
  const auto mean_x = [&](const Zone& zone) {
    double sum = 0;
    for (const int n : zone.nodes) sum += body.rest[n].x();
    return sum / static_cast<double>(zone.nodes.size());
  };
  for (int i = -8; i <= 0; ++i) predictor.follow(X.p + 0.5e-3 * i * Vec3::UnitX());
  EXPECT_GT(mean_x(select_zone(body, request(true))), mean_x(select_zone(body, request(false))) + 1e-3);
}

}  // namespace
}  // namespace hapticd
