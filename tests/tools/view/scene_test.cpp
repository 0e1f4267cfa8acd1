// The scene for the page: what is sent when, the surface after removals, what came loose, strain with hand
// answers.
#include "tools/view/scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>

#include "server/observe/diagnostics.h"
#include "tests/support/mesh_shapes.h"
#include "tools/view/frames.h"

namespace hapticd {
namespace {

std::map<std::string, std::string> messages_of(ViewScene& scene) {
  std::map<std::string, std::string> out;
  for (const SharedMessage& m : scene.messages()) out[m->key] = m->bytes;
  return out;
}

std::uint32_t word(const std::string& bytes, std::size_t offset) {
  std::uint32_t value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

std::vector<float> flat(const std::vector<Vec3>& nodes) {
  std::vector<float> out;
  for (const Vec3& x : nodes)
    for (int i = 0; i < 3; ++i) out.push_back(static_cast<float>(x[i]));
  return out;
}

// Two tetrahedra that share a face: 6 triangles; one of them alone: 4.
TetMesh pair() {
  return {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}}, {{0, 1, 2, 3}, {1, 2, 3, 4}}, {}};
}

TEST(ViewScene, ABodyIsToldOnceAndThenWhatMoved) {
  ViewScene scene;
  scene.tell_body(3, "pair", true, pair());
  auto first = messages_of(scene);
  EXPECT_EQ(first.size(), 4u);  // scene, rest, surface, motion
  EXPECT_NE(first["scene"].find("\"pair\""), std::string::npos);
  EXPECT_NE(first["scene"].find("\"shell\":true"), std::string::npos);
  EXPECT_EQ(word(first["surface/3"], 8), 6u);
  EXPECT_TRUE(messages_of(scene).empty());

  const std::vector<float> nodes = flat(pair().nodes);
  scene.tell_motion(3, 1, nodes, std::vector<std::uint8_t>{0b11});
  EXPECT_EQ(messages_of(scene).size(), 1u);
  scene.tell_motion(3, 2, nodes, std::vector<std::uint8_t>{0b01});
  auto removed = messages_of(scene);
  EXPECT_EQ(removed.size(), 2u);
  EXPECT_EQ(word(removed["surface/3"], 8), 4u);
  EXPECT_EQ(word(removed["surface/3"], 12), 1u);
  // The daemon was started again: what was gone is back.
  scene.tell_motion(3, 3, nodes, std::vector<std::uint8_t>{0b11});
  EXPECT_EQ(word(messages_of(scene)["surface/3"], 8), 6u);
}

// Two tetrahedra that a cut has parted: eight faces, of which the two at the cut are shown as cut. Ids that
// are none are left out.
TEST(ViewScene, FacesThatACutMadeAreShownAsCut) {
  TetMesh parted = pair();
  for (const int n : {1, 2, 3}) parted.nodes.push_back(parted.nodes[static_cast<std::size_t>(n)]);
  parted.tets[1] = {5, 6, 7, 4};
  ViewScene scene;
  scene.tell_body(3, "pair", true, pair());
  messages_of(scene);
  scene.tell_body(3, "pair", true, parted, {0, 4 + 3, 4000});
  const std::string surface = messages_of(scene)["surface/3"];
  ASSERT_EQ(word(surface, 8), 8u);
  const std::string flags = surface.substr(surface.size() - 8);
  EXPECT_EQ(std::count_if(flags.begin(), flags.end(), [](char f) { return f & view_cut; }), 2);
}

// Told of two, then a daemon with one: the second is gone.
TEST(ViewScene, InstrumentsAreThoseOfTheNewestDaemon) {
  ViewScene scene;
  scene.tell_instrument(1, 2, {"chopper", 7, {}});
  scene.tell_instrument(0, 2, {"phaco", 3, {}});
  const std::string both = messages_of(scene)["scene"];
  EXPECT_LT(both.find("\"phaco\""), both.find("\"chopper\""));
  EXPECT_NE(both.find("\"device\":7"), std::string::npos) << both;
  scene.tell_instrument(0, 1, {"phaco", 3, {}});
  EXPECT_EQ(messages_of(scene)["scene"].find("chopper"), std::string::npos);
}

// Nobody says who presses: the first instrument, on tissue.
TEST(ViewScene, EveryContactHasSomebodyWhoPresses) {
  ViewScene scene;
  scene.tell_contacts(1, std::vector<float>(14), std::vector<float>(14), std::vector<std::uint8_t>{1, 0});
  const std::string frame = messages_of(scene)["contacts"];
  ASSERT_EQ(frame.size(), 24u + 4 * 28 + 4);
  EXPECT_EQ(frame.substr(frame.size() - 4), (std::string{1, 0, 0, static_cast<char>(255)}));
}

TEST(ViewScene, WhatDoesNotFitIsLeftOut) {
  ViewScene scene;
  scene.tell_body(0, "pair", true, pair());
  messages_of(scene);
  scene.tell_motion(0, 1, std::vector<float>(6), std::vector<std::uint8_t>{0b11});
  scene.tell_motion(0, 1, std::vector<float>(15), std::vector<std::uint8_t>{});
  scene.tell_motion(1, 1, std::vector<float>(15), std::vector<std::uint8_t>{0b11});
  EXPECT_TRUE(messages_of(scene).empty());
}

// A bar cut through the middle: the smaller half is loose.
TEST(ViewScene, ThePieceThatCameLooseIsTheSmaller) {
  const TetMesh bar = box_mesh({5, 1, 1}, 5, 1, 1);
  const std::vector<int> across = faces_across(bar.tets);
  std::vector<std::uint8_t> alive(bar.tets.size(), 1);
  EXPECT_EQ(loose_tets(across, alive), std::vector<std::uint8_t>(bar.tets.size(), 0));
  const auto slab = [&](std::size_t e) {
    double x = 0;
    for (const int n : bar.tets[e]) x += bar.nodes[static_cast<std::size_t>(n)].x() / 4;
    return static_cast<int>(x);
  };
  for (std::size_t e = 0; e < alive.size(); ++e) alive[e] = slab(e) != 1;
  const std::vector<std::uint8_t> loose = loose_tets(across, alive);
  for (std::size_t e = 0; e < alive.size(); ++e) EXPECT_EQ(loose[e], slab(e) == 0) << e;
}

// Simple stretch by s along x: E = diag((s²−1)/2, 0, 0), dev = e (2/3, −1/3, −1/3), so ε = √(2/3 · 2/3) e =
// 2e/3.
TEST(ViewStrain, StretchHasItsHandAnswerAndRigidMotionNone) {
  const TetMesh box = box_mesh({1, 1, 1}, 2, 2, 2);
  const StrainAtNodes strain(box.nodes, box.tets);
  const std::vector<std::uint8_t> alive(box.tets.size(), 1);
  std::vector<Vec3> stretched = box.nodes, turned = box.nodes;
  const Quat q(Eigen::AngleAxisd(1.2, Vec3(1, 2, 3).normalized()));
  for (Vec3& x : stretched) x.x() *= 1.2;
  for (Vec3& x : turned) x = q * x + Vec3(4, 5, 6);
  const double e = 0.5 * (1.2 * 1.2 - 1);
  for (const float v : strain.of(flat(stretched), alive)) EXPECT_NEAR(v, 2 * e / 3, 1e-5);
  for (const float v : strain.of(flat(turned), alive)) EXPECT_NEAR(v, 0, 1e-5);
}

}  // namespace
}  // namespace hapticd
