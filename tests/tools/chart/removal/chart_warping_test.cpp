// Warping charted: the shapes are what they say, and a rigid turn is undone by warping alone.
#include "tools/chart/removal/chart_warping.h"

#include <gtest/gtest.h>

#include <cmath>

#include "physics/tissue/tetrahedron.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

const Vec3 size(8e-3, 8e-3, 4e-3);

TissueModel box(bool held) {
  TetMesh mesh = box_mesh(size, 4, 4, 2);
  for (Vec3& x : mesh.nodes) x -= 0.5 * size;
  const std::vector<int> fixed = held ? mesh.group("bottom")->nodes : std::vector<int>();
  return make_tissue_model(std::move(mesh), {3000, 0.45, 1000, 2, 2e-3}, fixed, Vec3::Zero());
}

TEST(ChartWarping, AnIndentationIsAsDeepAsAsked) {
  const TissueModel model = box(true);
  const std::vector<Vec3> x = indented(model, 0.3e-3);
  double deepest = 0;
  for (int n = 0; n < model.node_count(); ++n)
    deepest = std::max(deepest, model.mesh.nodes[n].z() - x[n].z());
  EXPECT_NEAR(deepest, 0.3e-3, 1e-12);
  for (int n = 0; n < model.node_count(); ++n)
    if (model.fixed[n]) {
      EXPECT_EQ(x[n], model.mesh.nodes[n]);
    }
}

TEST(ChartWarping, BendingKeepsTheNeutralFibreAndTurnsTheEndsByHalfTheAngle) {
  const TissueModel model = box(false);
  TissueState state = rest_state(model);
  const double angle = 0.8;
  state.x = bent(model, angle);
  const double radius = size.x() / angle;
  for (int n = 0; n < model.node_count(); ++n) {
    const Vec3& X = model.mesh.nodes[n];
    const Vec3 from_centre(state.x[n].x(), 0, state.x[n].z() - radius);
    EXPECT_NEAR(from_centre.norm(), radius - X.z(), 1e-12);
    EXPECT_NEAR(std::atan2(from_centre.x(), -from_centre.z()), X.x() / radius, 1e-12);
  }
}

TEST(ChartWarping, ARigidTurnIsUndoneByWarpingAlone) {
  WarpingSettings settings;
  settings.zone_nodes = 20;
  settings.patch_nodes = 8;
  settings.depths_mm = {0.2};
  settings.angles_deg = {30};
  int calls = 0;
  const std::vector<WarpingPoint> points =
      chart_warping(box(true), box(false), settings, [&](double, const std::string&) { return ++calls > 0; });
  ASSERT_EQ(points.size(), 24u);
  for (const WarpingPoint& p : points) {
    SCOPED_TRACE(p.shape + " " + p.method + (p.warping == Warping::none ? "" : " warped"));
    if (p.shape == "turning") {
      EXPECT_NEAR(p.largest_turn, M_PI / 6, 1e-9);
      if (p.warping != Warping::none) {
        EXPECT_LT(p.w_rel_error, 1e-9);
      } else {
        EXPECT_GT(p.w_rel_error, 1e-3);
      }
    }
    EXPECT_LT(p.w_rel_error, 1);
    EXPECT_GT(p.w_rel_error, 0);
  }
  EXPECT_EQ(calls, 4);
}

}  // namespace
}  // namespace hapticd
