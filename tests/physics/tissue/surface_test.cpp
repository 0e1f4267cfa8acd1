#include "physics/tissue/surface.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>
#include <set>
#include <stdexcept>

#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

Triangle sorted(Triangle t) {
  std::sort(t.begin(), t.end());
  return t;
}

// From scratch: faces of live tetrahedra that occur once.
std::map<int, Triangle> recomputed(const TetMesh& mesh, const std::vector<bool>& alive) {
  std::map<Triangle, std::vector<int>> owners;
  for (int t = 0; t < static_cast<int>(mesh.tets.size()); ++t)
    if (alive[t])
      for (int f = 0; f < 4; ++f) owners[sorted(outward_face(mesh.tets[t], f))].push_back(4 * t + f);
  std::map<int, Triangle> faces;
  for (const auto& [key, ids] : owners)
    if (ids.size() == 1) faces[ids[0]] = outward_face(mesh.tets[ids[0] / 4], ids[0] % 4);
  return faces;
}

TEST(BoundarySurface, BoxHasTwoTrianglesPerCellSideWoundOutward) {
  for (const int split : {5, 6}) {
    const Vec3 size(3, 2, 1);
    const TetMesh mesh = box_mesh(size, 3, 2, 2, split);
    const BoundarySurface surface(mesh);
    EXPECT_EQ(surface.faces().size(), 2u * 2u * (3 * 2 + 3 * 2 + 2 * 2));
    Vec3 total = Vec3::Zero();
    double volume = 0;
    for (const SurfaceFace& f : surface.faces()) {
      EXPECT_FALSE(f.cut);
      const Vec3& a = mesh.nodes[f.nodes[0]];
      const Vec3 area = 0.5 * (mesh.nodes[f.nodes[1]] - a).cross(mesh.nodes[f.nodes[2]] - a);
      total += area;
      volume += a.dot(area) / 3;
    }
    EXPECT_LT(total.norm(), 1e-12);
    EXPECT_NEAR(volume, size.prod(), 1e-12);  // positive: outward
  }
}

TEST(BoundarySurface, EqualsRecomputationUnderRandomRemovals) {
  const TetMesh mesh = box_mesh({1, 1, 1}, 4, 4, 4);
  std::set<int> original;
  const std::vector<bool> whole(mesh.tets.size(), true);
  for (const auto& [id, face] : recomputed(mesh, whole)) original.insert(id);
  for (unsigned seed = 0; seed < 5; ++seed) {
    std::mt19937 random(seed);
    BoundarySurface surface(mesh);
    std::vector<bool> alive(mesh.tets.size(), true);
    int left = static_cast<int>(mesh.tets.size());
    while (left > 0) {
      std::vector<int> gone;  // with repeats
      for (int k = 0; k < 9; ++k) gone.push_back(static_cast<int>(random() % mesh.tets.size()));
      if (left < 60)
        for (int t = 0; t < static_cast<int>(mesh.tets.size()); ++t) gone.push_back(t);
      for (const int t : gone) {
        left -= alive[t];
        alive[t] = false;
      }
      surface.remove(gone);
      const std::map<int, Triangle> expected = recomputed(mesh, alive);
      ASSERT_EQ(surface.faces().size(), expected.size());
      for (const SurfaceFace& f : surface.faces()) {
        const auto found = expected.find(f.id);
        ASSERT_NE(found, expected.end());
        EXPECT_EQ(f.nodes, found->second);
        EXPECT_EQ(f.cut, original.count(f.id) == 0);
      }
    }
    EXPECT_TRUE(surface.faces().empty());
  }
}

TEST(BoundarySurface, RefusesAFaceOfThreeTetrahedra) {
  TetMesh mesh;
  mesh.tets = {{0, 1, 2, 3}, {0, 1, 2, 4}, {0, 1, 2, 5}};
  EXPECT_THROW(BoundarySurface{mesh}, std::invalid_argument);
}

}  // namespace
}  // namespace hapticd
