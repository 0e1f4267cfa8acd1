#include "tools/record/surface_file.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

double enclosed_volume(const DisplaySurface& surface) {
  double volume = 0;
  for (const Triangle& t : surface.triangles) {
    const auto p = [&](int i) {
      return surface.points[static_cast<std::size_t>(t[static_cast<std::size_t>(i)])];
    };
    volume += p(0).dot(p(1).cross(p(2))) / 6;
  }
  return volume;
}

// The surface is closed and wound outward: by Gauss it holds the volume of the live tetrahedra.
TEST(SurfaceFile, EnclosesTheLiveTetrahedra) {
  const TetMesh mesh = box_mesh({2, 3, 4}, 2, 3, 4);
  const DisplaySurface whole = display_surface(mesh, mesh.nodes, {});
  EXPECT_NEAR(enclosed_volume(whole), 24, 1e-12);
  EXPECT_EQ(whole.triangles.size(), 2u * 2 * (2 * 3 + 3 * 4 + 2 * 4));
  EXPECT_EQ(std::count(whole.cut.begin(), whole.cut.end(), true), 0);

  std::vector<std::uint8_t> alive((mesh.tets.size() + 7) / 8, 0xff);
  double removed = 0;
  for (const std::size_t t : {3u, 50u, 51u, 100u}) {
    alive[t / 8] = static_cast<std::uint8_t>(alive[t / 8] & ~(1u << (t % 8)));
    const Tet& k = mesh.tets[t];
    const auto n = [&](int i) {
      return mesh.nodes[static_cast<std::size_t>(k[static_cast<std::size_t>(i)])];
    };
    removed += signed_volume(n(0), n(1), n(2), n(3));
  }
  const DisplaySurface less = display_surface(mesh, mesh.nodes, alive);
  EXPECT_NEAR(enclosed_volume(less), 24 - removed, 1e-12);
  EXPECT_GT(std::count(less.cut.begin(), less.cut.end(), true), 0);
}

TEST(SurfaceFile, VtkNamesItsPartsInOrder) {
  TetMesh mesh;
  mesh.nodes = {Vec3(9, 9, 9), Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1)};
  mesh.tets = {{1, 2, 3, 4}};
  const std::string vtk = to_vtk(display_surface(mesh, mesh.nodes, {}), "one\ntwo");
  std::size_t at = 0;
  for (const char* part :
       {"# vtk DataFile Version 3.0\none\nASCII\nDATASET POLYDATA\nPOINTS 4 double\n", "POLYGONS 4 16\n3 ",
        "CELL_DATA 4\nSCALARS cut int 1\nLOOKUP_TABLE default\n0\n0\n0\n0\n"}) {
    at = vtk.find(part, at);
    ASSERT_NE(at, std::string::npos) << part << "\n" << vtk;
  }
}

}  // namespace
}  // namespace hapticd
