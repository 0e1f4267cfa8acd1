#include "physics/cutting/opening.h"

#include <cmath>

#include "tests/physics/cutting/cut_body.h"
#include "tests/support/malloc_guard.h"

namespace hapticd {
namespace {

const auto mid_plane = [](const Vec3& X) { return std::abs(X.x() - 0.5) < 1e-9; };

CutBody unit_box(MeshRoom room = {200, 0}) { return {box_mesh({1, 1, 1}, 4, 4, 4, 6), room, {0, 62}}; }

TEST(Opening, APlaneMakesTwoPiecesOfTheSameVolume) {
  CutBody body = unit_box();
  const double volume = body.volume();
  const std::vector<int> faces = body.inner_faces(mid_plane);
  ASSERT_EQ(faces.size(), 32u);
  EXPECT_EQ(body.open(faces), CutStatus::done);
  EXPECT_EQ(body.check(), "");
  EXPECT_EQ(body.model.nodes_in_use, 125 + 25);
  EXPECT_EQ(body.change.nodes.size(), 25u);
  EXPECT_EQ(body.change.opened.size(), 32u);
  EXPECT_EQ(body.fragments(), 2);
  EXPECT_EQ(body.pieces(), 2);
  EXPECT_EQ(body.volume(), volume);
  EXPECT_NEAR(body.mass(), 1000, 1e-9);
  EXPECT_NEAR(body.cut_area(), 2, 1e-12);
  EXPECT_NEAR(body.surface_area(), 8, 1e-12);
  for (const auto& [here, there] : body.change.opened) {
    EXPECT_EQ(body.model.across[here], opened_face);
    EXPECT_EQ(body.model.across[there], opened_face);
  }
}

TEST(Opening, WhatIsNewIsWhereItsNodeIs) {
  CutBody body = unit_box();
  body.deform();
  body.model.mesh.groups.push_back({"middle", {62}, {}});
  CutBody before = body;
  EXPECT_EQ(body.open(body.inner_faces(mid_plane)), CutStatus::done);
  for (std::size_t k = 0; k < body.change.nodes.size(); ++k) {
    const int twin = body.change.nodes[k];
    const int node = body.change.node_of[k];
    EXPECT_EQ(twin, 125 + static_cast<int>(k));
    EXPECT_EQ(body.model.mesh.nodes[twin], before.model.mesh.nodes[node]);
    EXPECT_EQ(body.state.x[twin], before.state.x[node]);
    EXPECT_EQ(body.state.v[twin], before.state.v[node]);
    EXPECT_EQ(body.model.fixed[twin], node == 62);
    EXPECT_NEAR(body.state.mass[twin] + body.state.mass[node], before.state.mass[node], 1e-12);
  }
  EXPECT_EQ(body.model.mesh.group("middle")->nodes.size(), 2u);
  std::set<int> changed(body.change.tets.begin(), body.change.tets.end());
  EXPECT_EQ(changed.size(), body.change.tets.size());
  for (int t = 0; t < body.model.tet_count(); ++t)
    EXPECT_EQ(changed.contains(t), body.model.mesh.tets[t] != before.model.mesh.tets[t]);
}

TEST(Opening, EnergyForceAndMomentumStay) {
  CutBody body{box_mesh({1, 1, 1}, 4, 4, 4, 6), {200, 0}};
  body.deform();
  const double energy = elastic_energy(body.model, body.state);
  const VecX f = body.forces();
  const Vec3 momentum = body.momentum();
  EXPECT_EQ(body.open(body.inner_faces(mid_plane)), CutStatus::done);
  EXPECT_DOUBLE_EQ(elastic_energy(body.model, body.state), energy);
  EXPECT_LT((body.momentum() - momentum).norm(), 1e-12 * momentum.norm());
  VecX g = body.forces();
  for (std::size_t k = 0; k < body.change.nodes.size(); ++k)
    g.segment<3>(3 * body.change.node_of[k]) += g.segment<3>(3 * body.change.nodes[k]);
  EXPECT_LT((g - f).head(3 * 125).norm(), 1e-12 * f.norm());
}

TEST(Opening, FaceByFaceInAnyOrderEqualsAtOnce) {
  CutBody whole = unit_box();
  std::vector<int> faces = whole.inner_faces(mid_plane);
  EXPECT_EQ(whole.open(faces), CutStatus::done);
  for (unsigned seed = 0; seed < 20; ++seed) {
    std::mt19937 random(seed);
    std::shuffle(faces.begin(), faces.end(), random);
    CutBody body = unit_box();
    for (const int face : faces) {
      EXPECT_EQ(body.open({{face}}), CutStatus::done);
      ASSERT_EQ(body.check(), "");
    }
    EXPECT_EQ(body.model.nodes_in_use, whole.model.nodes_in_use);
    EXPECT_EQ(body.model.across, whole.model.across);
    EXPECT_EQ(body.pieces(), 2);
    EXPECT_NEAR(body.cut_area(), 2, 1e-12);
  }
}

TEST(Opening, AFaceThatAllItsNodesJoinStaysJoined) {
  CutBody body = unit_box();
  const std::vector<int> across = body.model.across;
  const auto inside = [](const Vec3& X) { return mid_plane(X) && !on_box_boundary(X, {1, 1, 1}); };
  const std::vector<int> faces = body.inner_faces(inside);
  EXPECT_EQ(body.open({{faces[0]}}), CutStatus::done);
  EXPECT_TRUE(body.change.empty());
  EXPECT_EQ(body.model.across, across);
  EXPECT_EQ(body.check(), "");
  // All inner faces of the plane: a lens-shaped crack, joined along its rim.
  EXPECT_EQ(body.open(faces), CutStatus::done);
  EXPECT_EQ(body.check(), "");
  EXPECT_EQ(body.model.nodes_in_use, 125 + 1);  // the middle one of nine; the other eight are the rim
  EXPECT_EQ(body.fragments(), 1);
}

TEST(Opening, WithoutRoomNothingChanges) {
  CutBody body = unit_box({24, 0});
  const CutBody before = body;
  EXPECT_EQ(body.open(body.inner_faces(mid_plane)), CutStatus::no_room);
  expect_same(body, before);
  EXPECT_EQ(body.check(), "");
  EXPECT_TRUE(body.change.empty());
  CutBody enough = unit_box({25, 0});
  EXPECT_EQ(enough.open(enough.inner_faces(mid_plane)), CutStatus::done);
}

TEST(Opening, TheBoundaryAndTheRemovedAreNothingToOpen) {
  CutBody body = unit_box();
  const std::vector<int> faces = body.inner_faces(mid_plane);
  std::vector<int> removed;
  for (const int face : faces) removed.push_back(face / 4);
  body.remove(removed);
  EXPECT_EQ(body.open(faces), CutStatus::nothing);
  EXPECT_EQ(body.open({{body.surface.faces()[0].id}}), CutStatus::nothing);
  EXPECT_EQ(body.check(), "");
}

TEST(Opening, RandomFacesAndRemovalsLeaveAValidMesh) {
  for (unsigned seed = 0; seed < 30; ++seed) {
    std::mt19937 random(seed);
    CutBody body{box_mesh({1, 1, 1}, 3, 3, 3, seed % 2 ? 5 : 6), {4000, 0}};
    const double volume = body.volume();
    double removed = 0;
    for (int k = 0; k < 40; ++k) {
      std::vector<int> faces;
      for (int i = 0; i < 6; ++i) faces.push_back(static_cast<int>(random() % body.model.across.size()));
      (void)body.open(faces);
      ASSERT_EQ(body.check(), "") << seed << ' ' << k;
      if (k % 4 != 3) continue;
      const int t = static_cast<int>(random() % body.model.tets_in_use);
      if (body.state.alive[t]) removed += body.model.volume[t];
      body.remove({t});
      ASSERT_EQ(body.check(), "") << seed << ' ' << k;
    }
    EXPECT_NEAR(body.volume() + removed, volume, 1e-12 * volume);
    EXPECT_GT(body.model.nodes_in_use, 64);
  }
}

TEST(Opening, AllocatesNothing) {
  if (!MallocGuard::available()) GTEST_SKIP() << "a sanitizer owns malloc";
  CutBody body = unit_box();
  const std::vector<int> faces = body.inner_faces(mid_plane);
  const MallocGuard guard;
  EXPECT_EQ(body.open(faces), CutStatus::done);
  EXPECT_EQ(guard.allocations(), 0);
}

}  // namespace
}  // namespace hapticd
