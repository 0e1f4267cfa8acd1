// Mesh quality: shapes whose measures are known, and boundaries that can be counted by hand.
#include "physics/tissue/mesh_quality.h"

#include <gtest/gtest.h>

#include <numeric>

#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

TetMesh one_tet(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) {
  return {{a, b, c, d}, {{0, 1, 2, 3}}, {}};
}

TEST(MeshQuality, TheRegularTetrahedronIsOneAtAnySizeAndAFlatOneZero) {
  for (const double s : {1e-3, 1.0, 40.0}) {
    const TetMesh mesh =
        one_tet(s * Vec3(1, 1, 1), s * Vec3(-1, 1, -1), s * Vec3(1, -1, -1), s * Vec3(-1, -1, 1));
    const MeshQuality q = measure_mesh(mesh);
    EXPECT_NEAR(q.ratio.least, 1, 1e-14);
    EXPECT_NEAR(q.dihedral.least, 70.528779, 1e-6);
    EXPECT_NEAR(q.dihedral.greatest, 70.528779, 1e-6);
    EXPECT_NEAR(q.total_volume / (s * s * s), 8.0 / 3, 1e-12);
    EXPECT_EQ(q.histogram[9], 1);
  }
  EXPECT_EQ(mean_ratio({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}), 0);
}

// Three right angles and three of 54.74°; η = 12 (1/2)^⅔ / 9.
TEST(MeshQuality, TheCornerOfACube) {
  const MeshQuality q = measure_mesh(one_tet({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}));
  EXPECT_NEAR(q.dihedral.greatest, 90, 1e-9);
  EXPECT_NEAR(q.dihedral.least, 54.735610, 1e-6);
  EXPECT_NEAR(q.ratio.mean, 12 * std::pow(0.5, 2.0 / 3) / 9, 1e-14);
}

TEST(MeshQuality, ABoxHasTheBoxsVolumeAreaAndOneShell) {
  const MeshQuality q = measure_mesh(box_mesh({2, 3, 4}, 4, 3, 2));
  EXPECT_NEAR(q.total_volume, 24, 1e-12);
  EXPECT_NEAR(q.boundary_area, 52, 1e-12);
  EXPECT_EQ(q.boundary_faces, 2 * 2 * (4 * 3 + 3 * 2 + 4 * 2));
  EXPECT_EQ(q.boundary_nodes, 5 * 4 * 3 - 3 * 2 * 1);
  EXPECT_EQ(q.shells, 1);
  EXPECT_EQ(q.open_edges, 0);
  EXPECT_EQ(q.pieces, 1);
  EXPECT_EQ(std::accumulate(q.histogram.begin(), q.histogram.end(), 0), 6 * 24);
}

// A cavity is a shell more; two tetrahedra on one edge are pinched there.
TEST(MeshQuality, CavitiesAndPinchedEdgesAreSeen) {
  TetMesh mesh = box_mesh({3, 3, 3}, 3, 3, 3);
  mesh.tets.erase(mesh.tets.begin() + 6 * 13, mesh.tets.begin() + 6 * 14);  // the cell in the middle
  EXPECT_EQ(measure_mesh(mesh).shells, 2);

  const TetMesh two = {
      {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, -1, 0}, {0, 0, -1}}, {{0, 1, 2, 3}, {0, 1, 4, 5}}, {}};
  const MeshQuality q = measure_mesh(two);
  EXPECT_EQ(q.open_edges, 1);
  EXPECT_EQ(q.pieces, 1);
}

}  // namespace
}  // namespace hapticd
