#include "physics/tissue/fragments.h"

#include <gtest/gtest.h>

#include <numeric>

#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

const Vec3 size(1e-2, 1e-2, 3e-2);
const Material soft{3000, 0.45, 1000, 0, 0};

// A column of three cells (2 × 2 × 3), held at the bottom.
TissueModel column() {
  TetMesh mesh = box_mesh(size, 2, 2, 3);
  const std::vector<int> bottom = mesh.group("bottom")->nodes;
  return make_tissue_model(std::move(mesh), soft, bottom, Vec3::Zero());
}

std::vector<int> layer(int k) {
  std::vector<int> tets(24);
  std::iota(tets.begin(), tets.end(), 24 * k);
  return tets;
}

TEST(Fragments, OneBodyIsOneFragment) {
  const TissueModel model = column();
  const std::vector<Fragment> fragments = find_fragments(model, rest_state(model));
  ASSERT_EQ(fragments.size(), 1u);
  EXPECT_TRUE(fragments[0].held);
  EXPECT_EQ(static_cast<int>(fragments[0].tets.size()), model.tet_count());
  EXPECT_NEAR(fragments[0].volume, size.prod(), 1e-12 * size.prod());
}

TEST(Fragments, RemovingTheMiddleLayerMakesTwo) {
  const TissueModel model = column();
  TissueState state = rest_state(model);
  remove_tets(model, state, layer(1));
  const std::vector<Fragment> fragments = find_fragments(model, state);
  const std::vector<int> label = label_fragments(model, state);
  ASSERT_EQ(fragments.size(), 2u);
  EXPECT_TRUE(fragments[0].held);
  EXPECT_FALSE(fragments[1].held);
  EXPECT_EQ(fragments[0].tets, layer(0));
  EXPECT_EQ(fragments[1].tets, layer(2));
  EXPECT_NEAR(fragments[1].volume, size.prod() / 3, 1e-12 * size.prod());
  for (int t = 0; t < model.tet_count(); ++t) EXPECT_EQ(label[t], t < 24 ? 0 : t < 48 ? -1 : 1);
}

// Two tetrahedra with one node in common, then an edge, then a face.
TEST(Fragments, AFaceJoinsFragmentsANodeJoinsPieces) {
  const std::vector<Vec3> nodes = {{0, 0, 0},  {1, 0, 0},  {0, 1, 0}, {0, 0, 1},
                                   {-1, 0, 0}, {0, -1, 0}, {0, 0, -1}};
  const auto joined = [&](const Tet& other, std::size_t fragments) {
    TetMesh mesh;
    mesh.nodes = nodes;
    mesh.tets = {{0, 1, 2, 3}, other};
    ASSERT_GT(signed_volume(nodes[other[0]], nodes[other[1]], nodes[other[2]], nodes[other[3]]), 0);
    const TissueModel model = make_tissue_model(std::move(mesh), soft, {}, Vec3::Zero());
    const TissueState state = rest_state(model);
    EXPECT_EQ(find_fragments(model, state).size(), fragments);
    EXPECT_EQ(label_pieces(model, state), (std::vector<int>{0, 0}));
  };
  joined({0, 4, 6, 5}, 2);
  joined({0, 1, 5, 6}, 2);
  joined({0, 1, 6, 2}, 1);
}

// Three tetrahedra in a row, joined by faces, the first held: without the middle one the last hangs by the
// edge that all three share. It does not if it shares nothing, nor if a third node of it is fixed; if one of
// the two that it hangs by is, it turns about them all the same, and alone it does about one or two.
TEST(Fragments, WhatHangsByAnEdgeIsACrumb) {
  TetMesh mesh;
  mesh.nodes = {{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
  mesh.tets = {{0, 2, 3, 1}, {0, 3, 4, 1}, {0, 4, 5, 1}};
  const auto hinged = [&](std::vector<int> fixed, std::vector<int> gone, int most) {
    const TissueModel model = make_tissue_model(mesh, soft, fixed, Vec3::Zero());
    TissueState state = rest_state(model);
    remove_tets(model, state, gone);
    return hinged_fragments(model, state, gone, most);
  };
  EXPECT_EQ(hinged({2}, {1}, 8), std::vector<int>{2});
  EXPECT_TRUE(hinged({2}, {1}, 0).empty());     // larger than what may go
  EXPECT_TRUE(hinged({2, 5}, {1}, 8).empty());  // held
  EXPECT_EQ(hinged({2, 0}, {1}, 8), std::vector<int>{2});
  EXPECT_EQ(hinged({4}, {0, 1}, 8), std::vector<int>{2});
  EXPECT_EQ(hinged({4, 5}, {0, 1}, 8), std::vector<int>{2});
  EXPECT_TRUE(hinged({0, 4, 5}, {0, 1}, 8).empty());
  EXPECT_TRUE(hinged({0, 2, 3}, {2}, 8).empty());  // what is left is joined by a face, and held by one
  EXPECT_TRUE(hinged({2}, {0, 1}, 8).empty());     // free: it hangs on nothing
}

// As there, but springs at three nodes of the last hold it no better; nor do they alone. A fragment that is
// looked at itself is told as one beside a removed tetrahedron is.
TEST(Fragments, SpringsHoldNoCrumb) {
  TetMesh mesh;
  mesh.nodes = {{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
  mesh.tets = {{0, 2, 3, 1}, {0, 3, 4, 1}, {0, 4, 5, 1}};
  TissueModel model = make_tissue_model(mesh, soft, std::vector<int>{2}, Vec3::Zero());
  model.springs.resize(6);
  for (const int n : {0, 4, 5}) model.springs[n] = {1, mesh.nodes[n]};
  for (const std::vector<int>& gone : {std::vector<int>{1}, std::vector<int>{0, 1}}) {
    TissueState state = rest_state(model);
    remove_tets(model, state, gone);
    EXPECT_EQ(hinged_fragments(model, state, gone, 8), std::vector<int>{2});
    EXPECT_EQ(hinged_fragments(model, state, std::vector<int>{2}, 8), std::vector<int>{2});
  }
}

TEST(Fragments, NothingLeftIsNoFragment) {
  const TissueModel model = column();
  TissueState state = rest_state(model);
  for (int k = 0; k < 3; ++k) remove_tets(model, state, layer(k));
  EXPECT_TRUE(find_fragments(model, state).empty());
}

}  // namespace
}  // namespace hapticd
