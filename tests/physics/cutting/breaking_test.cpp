// Faces break by the tension across them.
#include "physics/cutting/breaking.h"

#include <gtest/gtest.h>

#include "physics/cutting/mesh_check.h"
#include "physics/cutting/opening.h"
#include "physics/tissue/fragments.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

constexpr double young = 2e4, size = 10e-3;

struct Bar {
  TissueModel model = make_tissue_model(box_mesh({4 * size, size, size}, 8, 2, 2), {young, 0, 1000, 0, 0}, {},
                                        Vec3::Zero(), {200, 0});
  TissueState state = rest_state(model);
  BoundarySurface surface{model.mesh};
  CutWorkspace work{model};

  // Uniform: x = (1 + G) X.
  void strain(const Mat3& G) {
    for (int n = 0; n < model.node_count(); ++n) state.x[n] = model.mesh.nodes[n] + G * model.mesh.nodes[n];
    update_rotations(model, state);
  }
  std::vector<int> broken(double toughness, int most = 1000) const {
    return faces_that_break(model, state, surface, work.held_open,
                            {.toughness = toughness, .most = most, .begins = true});
  }
  Vec3 normal(int face) const {
    const Triangle n = outward_face(model.mesh.tets[face / 4], face % 4);
    const auto& X = model.mesh.nodes;
    return (X[n[1]] - X[n[0]]).cross(X[n[2]] - X[n[0]]).normalized();
  }
};

Mat3 along_x(double strain) {
  Mat3 G = Mat3::Zero();
  G(0, 0) = strain;
  return G;
}

// σ = E e across the bar: a release in the square of both, whatever way the bar has turned, and none where it
// is pressed. Those across it break first.
TEST(Breaking, AFaceReleasesTheSquareOfTheTensionAcrossIt) {
  Bar bar;
  bar.strain(along_x(0.1));
  const std::vector<int> first = bar.broken(1e-3, 1);
  ASSERT_EQ(first.size(), 1u);
  EXPECT_NEAR(std::abs(bar.normal(first[0]).x()), 1, 1e-12);
  const double at = release_of_face(bar.model, bar.state, first[0]);
  bar.strain(along_x(0.2));
  EXPECT_NEAR(release_of_face(bar.model, bar.state, first[0]) / at, 4, 1e-9);

  const Mat3 turn = Eigen::AngleAxisd(1.0, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  for (Vec3& x : bar.state.x) x = turn * x;
  for (Mat3& R : bar.state.rotation) R = turn * R;
  EXPECT_NEAR(release_of_face(bar.model, bar.state, first[0]) / at, 4, 1e-9);

  bar.strain(along_x(-0.2));
  EXPECT_EQ(release_of_face(bar.model, bar.state, first[0]), 0);
  EXPECT_TRUE(bar.broken(1e-12).empty());
}

TEST(Breaking, OnlyFacesAtTheSurfaceAndAtMostSoMany) {
  Bar bar;
  bar.strain(along_x(0.1));
  EXPECT_EQ(bar.broken(1e-12, 3).size(), 3u);
  EXPECT_TRUE(bar.broken(1e9).empty());
  std::vector<char> outer(bar.model.node_count(), 0);
  for (const SurfaceFace& f : bar.surface.faces())
    for (const int n : f.nodes) outer[n] = 1;
  for (const int face : bar.broken(1e-12)) {
    int at_surface = 0;
    for (const int n : outward_face(bar.model.mesh.tets[face / 4], face % 4)) at_surface += outer[n];
    EXPECT_GE(at_surface, 2);
  }
}

// Step by step a crack goes in from the surface until the bar is in pieces, and the mesh is valid throughout.
TEST(Breaking, ACrackGoesFromTheSurfaceThroughTheBar) {
  Bar bar;
  bar.strain(along_x(0.1));
  TopologyChange change(bar.model);
  int pieces = 1;
  for (int step = 0; step < 200 && pieces < 2; ++step) {
    const std::vector<int> faces = bar.broken(1e-3, 4);
    ASSERT_FALSE(faces.empty()) << step;
    change.clear();
    ASSERT_EQ(open_faces(bar.model, bar.state, bar.work, faces, change), CutStatus::done);
    bar.surface.follow(bar.model, change.tets, change.opened);
    pieces = find_pieces(bar.model, bar.state).count();
  }
  EXPECT_EQ(pieces, 2);
  EXPECT_EQ(check_mesh(bar.model, bar.state, bar.work, &bar.surface), "");
}

}  // namespace
}  // namespace hapticd
