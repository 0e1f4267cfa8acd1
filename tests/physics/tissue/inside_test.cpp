#include "physics/tissue/inside.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/physics/tissue/random_shapes.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

TEST(Inside, OfABoxIsWhatItsSidesSay) {
  const Vec3 size(3e-3, 2e-3, 1e-3);
  const TetMesh mesh = box_mesh(size, 3, 2, 2);
  const BoundarySurface surface(mesh);
  std::mt19937 random(5);
  int inside = 0;
  for (int i = 0; i < 500; ++i) {
    const Vec3 p = 0.5 * size + random_vector(random, 3e-3);
    const bool within = (p.array() > 0).all() && (p.array() < size.array()).all();
    EXPECT_EQ(is_inside(surface.faces(), mesh.nodes, p), within) << p.transpose();
    inside += within;
  }
  EXPECT_GT(inside, 5);
}

TEST(Inside, AHoleThatWasCutIsOutside) {
  const Vec3 size(3e-3, 3e-3, 3e-3);
  const TetMesh mesh = box_mesh(size, 5, 5, 5);
  BoundarySurface surface(mesh);
  const Vec3 middle = 0.5 * size;
  EXPECT_TRUE(is_inside(surface.faces(), mesh.nodes, middle));
  std::vector<int> gone;
  for (int t = 0; t < static_cast<int>(mesh.tets.size()); ++t) {
    Vec3 centre = Vec3::Zero();
    for (const int n : mesh.tets[t]) centre += 0.25 * mesh.nodes[n];
    if ((centre - middle).lpNorm<Eigen::Infinity>() < 0.3e-3) gone.push_back(t);
  }
  ASSERT_GE(gone.size(), 5u);
  surface.remove(gone);
  EXPECT_FALSE(is_inside(surface.faces(), mesh.nodes, middle));
}

}  // namespace
}  // namespace hapticd
