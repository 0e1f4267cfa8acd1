#include "physics/simulation/cutting/material_point.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "physics/tissue/surface.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

class MaterialPoints : public testing::Test {
 protected:
  MaterialPoints() {
    // An affine deformation: every point goes where the map says, whatever tetrahedron it is in.
    for (Vec3& x : state_.x) x = A_ * x + b_;
  }
  MaterialPoint at(const Vec3& rest) const {
    for (int t = 0; t < model_.tet_count(); ++t) {
      const MaterialPoint p = point_in(model_, t, rest);
      if (*std::min_element(p.weight.begin(), p.weight.end()) >= 0) return p;
    }
    return {};
  }

  const TissueModel model_ = make_tissue_model(box_mesh(Vec3(3e-3, 2e-3, 1e-3), 6, 4, 3),
                                               {3000, 0.45, 1000, 0, 0}, {}, Vec3::Zero());
  TissueState state_ = rest_state(model_);
  const Mat3 A_ = (Mat3() << 1.2, 0.1, 0, -0.2, 0.9, 0.3, 0, 0.1, 1.1).finished();
  const Vec3 b_ = {1e-3, 2e-3, -3e-3};
  const Vec3 low_ = model_.mesh.nodes.front();
};

TEST_F(MaterialPoints, AWalkEndsWhereItsWayEnds) {
  MaterialPoint p = at(low_ + Vec3(0.31e-3, 0.27e-3, 0.13e-3));
  ASSERT_TRUE(p.any());
  const Vec3 start = p.rest, way = {2.3e-3, 1.4e-3, 0.71e-3};
  EXPECT_EQ(walk(model_, state_, p, way), 1);
  EXPECT_LT((p.rest - start - way).norm(), 1e-15);
  for (const double w : p.weight) EXPECT_GE(w, -1e-9);
  EXPECT_LT((place_of(model_, state_.x, p) - (A_ * p.rest + b_)).norm(), 1e-15);
  EXPECT_LT((deformation_at(model_, state_.x, p) - A_).norm(), 1e-9);
}

TEST_F(MaterialPoints, AWalkEndsAtTheBoundary) {
  MaterialPoint p = at(low_ + Vec3(0.31e-3, 0.27e-3, 0.13e-3));
  EXPECT_NEAR(walk(model_, state_, p, Vec3(0, 0, 2e-3)), (1e-3 - 0.13e-3) / 2e-3, 1e-9);
  EXPECT_NEAR(p.rest.z(), low_.z() + 1e-3, 1e-15);
}

TEST_F(MaterialPoints, WhatWentIsNoWay) {
  for (int t = 0; t < model_.tet_count(); ++t) {
    double x = 0;
    for (const int n : model_.mesh.tets[t]) x += model_.mesh.nodes[n].x() / 4;
    if (x - low_.x() > 1.5e-3) state_.alive[t] = 0;
  }
  MaterialPoint p = at(low_ + Vec3(0.31e-3, 0.27e-3, 0.13e-3));
  EXPECT_NEAR(walk(model_, state_, p, Vec3(2e-3, 0, 0)), (1.5e-3 - 0.31e-3) / 2e-3, 1e-9);
}

TEST_F(MaterialPoints, ASegmentEntersThroughTheFaceAgainstIt) {
  const BoundarySurface surface(model_.mesh);
  const Vec3 rest = low_ + Vec3(1.23e-3, 0.77e-3, 1e-3);
  const Vec3 way = A_ * Vec3(0, 0, -2e-3);
  const auto hit = first_entry(model_, state_, surface, A_ * rest + b_ - 0.25 * way, way);
  ASSERT_TRUE(hit);
  EXPECT_NEAR(hit->part, 0.25, 1e-9);
  EXPECT_LT((hit->point.rest - rest).norm(), 1e-12);
  EXPECT_FALSE(first_entry(model_, state_, surface, A_ * rest + b_ + 0.1 * way, 0.1 * way));
}

}  // namespace
}  // namespace hapticd
