#include "physics/cutting/subdivision.h"

#include <cmath>

#include "physics/tissue/mesh_quality.h"
#include "tests/physics/cutting/cut_body.h"
#include "tests/support/malloc_guard.h"

namespace hapticd {
namespace {

TetMesh one_tet() {
  TetMesh mesh;
  mesh.nodes = {
      {0, 0, 0}, {1, 0, 0}, {0.5, std::sqrt(0.75), 0}, {0.5, std::sqrt(1.0 / 12), std::sqrt(2.0 / 3)}};
  mesh.tets = {{0, 1, 2, 3}};
  return mesh;
}

TEST(Subdivision, EachEdgeOfOneTetrahedron) {
  for (int a = 0; a < 4; ++a)
    for (int b = 0; b < 4; ++b) {
      if (a == b) continue;
      CutBody body{one_tet(), {1, 1}};
      const double volume = body.volume();
      ASSERT_EQ(body.split(a, b, 0.3), CutStatus::done);
      EXPECT_EQ(body.check(), "");
      EXPECT_EQ(body.model.parent[1], 0);
      EXPECT_NEAR(body.model.volume[0], 0.3 * volume, 1e-15);  // the half at a
      EXPECT_NEAR(body.model.volume[1], 0.7 * volume, 1e-15);
      EXPECT_EQ(body.change.tets, (std::vector<int>{0, 1}));
      EXPECT_EQ(body.change.nodes, (std::vector<int>{4}));
      EXPECT_EQ(body.surface.faces().size(), 6u);
      for (const SurfaceFace& face : body.surface.faces()) EXPECT_FALSE(face.cut);
      EXPECT_NEAR(body.mass(), 1000 * volume, 1e-12);
    }
}

// x_m follows a and b, so the split body's forces on the whole one's nodes are f_a + (1 − s) f_m and f_b + s
// f_m.
TEST(Subdivision, EnergyAndForceOfADeformedBodyStay) {
  for (const Law law : {Law::corotational, Law::guarded}) {
    TetMesh mesh = box_mesh({1, 1, 1}, 2, 2, 2, 6);
    jitter_interior(mesh, {1, 1, 1}, 0.1, 1);
    CutBody body{std::move(mesh), {100, 2000}, {}, law};
    body.deform();
    if (law == Law::guarded) {
      for (Vec3& x : body.state.x) x.z() *= 0.4;
      update_rotations(body.model, body.state);
      ASSERT_FALSE(body.state.collapsed.empty());
    }
    const double energy = elastic_energy(body.model, body.state);
    const VecX f = body.forces();
    std::mt19937 random(3);
    struct Split {
      int a, b, m;
      double s;
    };
    std::vector<Split> splits;
    for (int k = 0; k < 40; ++k) {
      const auto [a, b] = body.random_edge(random);
      const double s = 0.25 + 0.5 * static_cast<double>(random() % 1000) / 1000;
      ASSERT_EQ(body.split(a, b, s), CutStatus::done);
      splits.push_back({a, b, body.model.nodes_in_use - 1, s});
    }
    const auto expect_kept = [&] {
      EXPECT_NEAR(elastic_energy(body.model, body.state), energy, 1e-11 * energy);
      VecX g = body.forces();
      for (auto at = splits.rbegin(); at != splits.rend(); ++at) {
        g.segment<3>(3 * at->a) += (1 - at->s) * g.segment<3>(3 * at->m);
        g.segment<3>(3 * at->b) += at->s * g.segment<3>(3 * at->m);
      }
      EXPECT_LT((g - f).head(3 * 27).norm(), 1e-10 * f.norm());
    };
    expect_kept();
    const std::size_t collapsed = body.state.collapsed.size();
    update_rotations(body.model, body.state);
    EXPECT_EQ(body.state.collapsed.size(), collapsed);
    expect_kept();
  }
}

TEST(Subdivision, RandomSplitsAndRemovalsLeaveAValidMesh) {
  for (unsigned seed = 0; seed < 30; ++seed) {
    std::mt19937 random(seed);
    TetMesh mesh = box_mesh({1, 1, 1}, 2, 2, 2, seed % 2 ? 5 : 6);
    jitter_interior(mesh, {1, 1, 1}, 0.1, seed);
    CutBody body{std::move(mesh), {300, 5000}};
    const double volume = body.volume();
    double removed = 0;
    for (int k = 0; k < 60; ++k) {
      const auto [a, b] = body.random_edge(random);
      ASSERT_EQ(body.split(a, b, 0.5), CutStatus::done);
      if (k % 5 == 4) {
        const int t = static_cast<int>(random() % body.model.tets_in_use);
        if (body.state.alive[t]) removed += body.model.volume[t];
        body.remove({t});
      }
      ASSERT_EQ(body.check(), "") << seed << ' ' << k;
    }
    EXPECT_NEAR(body.volume() + removed, volume, 1e-9 * volume);
    if (removed == 0) {
      EXPECT_NEAR(body.surface_area(), 6, 1e-9);
    }
  }
}

TEST(Subdivision, OpenedFacesAreSplitAsTheyAre) {
  CutBody body{box_mesh({1, 1, 1}, 2, 2, 2, 6), {300, 5000}};
  const auto middle = [](const Vec3& X) { return std::abs(X.x() - 0.5) < 1e-9; };
  std::vector<int> faces = body.inner_faces(middle);
  faces.resize(faces.size() / 2);
  EXPECT_EQ(body.open(faces), CutStatus::done);
  std::mt19937 random(7);
  for (int k = 0; k < 60; ++k) {
    const auto [a, b] = body.random_edge(random);
    ASSERT_EQ(body.split(a, b, 0.5), CutStatus::done);
    ASSERT_EQ(body.check(), "") << k;
  }
  // What has not opened of the faces that were to, is remembered by their parts.
  EXPECT_EQ(body.open(body.inner_faces(middle)), CutStatus::done);
  EXPECT_EQ(body.check(), "");
  EXPECT_EQ(body.pieces(), 2);
  EXPECT_NEAR(body.cut_area(), 2, 1e-12);
}

TEST(Subdivision, GroupsAndFixedNodesFollow) {
  TetMesh mesh = one_tet();
  mesh.groups = {{"edge", {0, 1}, {}}, {"all", {0, 1, 2, 3}, {0}}};
  CutBody body{std::move(mesh), {3, 10}, {0, 1}};
  ASSERT_EQ(body.split(0, 1, 0.5), CutStatus::done);
  ASSERT_EQ(body.split(0, 2, 0.5), CutStatus::done);
  EXPECT_TRUE(body.model.fixed[4]);
  EXPECT_FALSE(body.model.fixed[5]);
  EXPECT_EQ(body.model.mesh.group("edge")->nodes, (std::vector<int>{0, 1, 4}));
  EXPECT_EQ(body.model.mesh.group("all")->nodes, (std::vector<int>{0, 1, 2, 3, 4, 5}));
  EXPECT_EQ(static_cast<int>(body.model.mesh.group("all")->tets.size()), body.model.tets_in_use);
}

TEST(Subdivision, RefusalsChangeNothing) {
  for (const MeshRoom room : {MeshRoom{0, 100}, MeshRoom{10, 3}}) {
    CutBody body{box_mesh({1, 1, 1}, 2, 2, 2, 6), room};
    const CutBody before = body;
    EXPECT_EQ(body.split(0, 13, 0.5), CutStatus::no_room);  // a cell's diagonal: six tetrahedra
    expect_same(body, before);
    EXPECT_EQ(body.check(), "");
  }
  CutBody body{box_mesh({1, 1, 1}, 2, 2, 2, 6), {10, 100}};
  const CutBody before = body;
  EXPECT_EQ(body.split(0, 13, 0.01, 0.05), CutStatus::poor);
  EXPECT_EQ(body.split(0, 26, 0.5), CutStatus::nothing);  // no edge
  EXPECT_EQ(body.split(0, 13, 0.0), CutStatus::nothing);
  expect_same(body, before);
  EXPECT_EQ(body.split(0, 13, 0.5, 0.05), CutStatus::done);
}

TEST(Subdivision, AllocatesNothing) {
  if (!MallocGuard::available()) GTEST_SKIP() << "a sanitizer owns malloc";
  CutBody body{box_mesh({1, 1, 1}, 2, 2, 2, 6), {10, 100}};
  const MallocGuard guard;
  EXPECT_EQ(body.split(0, 13, 0.5), CutStatus::done);
  EXPECT_EQ(guard.allocations(), 0);
}

TEST(DihedralQuality, OfShapesWithKnownAngles) {
  const TetMesh regular = one_tet();
  const auto of = [](const TetMesh& m) {
    return dihedral_quality(m.nodes[0], m.nodes[1], m.nodes[2], m.nodes[3]);
  };
  EXPECT_NEAR(of(regular), 1, 1e-12);
  // A cube's corner: three right angles and three with tan θ = √2, sin θ = √(2/3).
  EXPECT_NEAR(dihedral_quality({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}),
              std::sqrt(2.0 / 3) * 3 / (2 * std::sqrt(2.0)), 1e-12);
  // The tetrahedron (0,0,0) (1,0,0) (1,1,0) (1,1,1) of a cube: the least angles are 45°.
  EXPECT_NEAR(dihedral_quality({0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {1, 1, 1}), 3.0 / 4, 1e-12);
  EXPECT_LT(dihedral_quality({0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {0, 0, 1}), 0);
}

}  // namespace
}  // namespace hapticd
