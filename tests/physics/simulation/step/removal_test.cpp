#include "physics/simulation/step/removal.h"

#include <random>

#include <gtest/gtest.h>

#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

Primitive sphere(double r) {
  Primitive p;
  p.shape = Shape::sphere;
  p.radius = r;
  return p;
}

Primitive capsule(double r, double half) {
  Primitive p;
  p.shape = Shape::capsule;
  p.radius = r;
  p.half_length = half;
  return p;
}

const std::array<Vec3, 4> corner = {Vec3(0, 0, 0), Vec3(1e-3, 0, 0), Vec3(0, 1e-3, 0), Vec3(0, 0, 1e-3)};

TEST(Removal, SphereAgainstSlantedFace) {
  // The face x + y + z = 1 mm lies 1/√3 mm from the origin; beyond it the distance grows along (1,1,1).
  const Vec3 out = Vec3::Ones().normalized();
  const double face = 1e-3 / std::sqrt(3.0);
  for (const double gap : {1e-5, 1e-4, 1e-3}) {
    const Pose X{(face + gap) * out, Quat::Identity()};
    EXPECT_TRUE(intersects(corner, sphere(gap + 2e-6), X, 0));
    EXPECT_FALSE(intersects(corner, sphere(gap - 2e-6), X, 0));
    EXPECT_TRUE(intersects(corner, sphere(gap - 2e-6), X, 4e-6)) << "the stroke must grow the tip";
  }
}

TEST(Removal, TipInsideAndTetInside) {
  EXPECT_TRUE(intersects(corner, sphere(1e-5), {Vec3(1e-4, 1e-4, 1e-4), Quat::Identity()}, 0));
  EXPECT_TRUE(intersects(corner, sphere(1e-2), {Vec3(1e-4, 1e-4, 1e-4), Quat::Identity()}, 0));
}

TEST(Removal, CapsuleLiesAlongItsAxis) {
  // A capsule along z beside the edge from the origin to (0,0,1): distance 0.5 mm in −x.
  const Pose X{Vec3(-5e-4, 0, 5e-4), Quat::Identity()};
  EXPECT_TRUE(intersects(corner, capsule(5.02e-4, 1e-3), X, 0));
  EXPECT_FALSE(intersects(corner, capsule(4.98e-4, 1e-3), X, 0));
  const Pose stale{X.p, Quat(Eigen::AngleAxisd(M_PI / 2, Vec3::UnitY()))};
  EXPECT_TRUE(intersects(corner, capsule(1e-5, 6e-4), stale, 0));
}

// Against sampling: the exact test must find every tetrahedron with a sampled point inside the tip,
// and none whose distance (bounded below by sampling on a fine lattice) is clearly positive.
TEST(Removal, AgreesWithSampledTetrahedra) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> u(-1e-3, 1e-3);
  int hits = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    std::array<Vec3, 4> c;
    for (Vec3& v : c) v = Vec3(u(random), u(random), u(random));
    const Primitive tip = trial % 2 ? capsule(2e-4, 3e-4) : sphere(3e-4);
    const Pose X{Vec3(u(random), u(random), u(random)), Quat::UnitRandom()};
    double nearest = 1, edge = 0;
    for (int a = 0; a < 4; ++a) edge = std::max(edge, (c[a] - c[(a + 1) % 4]).norm());
    const int n = 12;
    for (int i = 0; i <= n; ++i)
      for (int j = 0; i + j <= n; ++j)
        for (int k = 0; i + j + k <= n; ++k) {
          const Vec3 p = (i * c[0] + j * c[1] + k * c[2] + (n - i - j - k) * c[3]) / n;
          nearest = std::min(nearest, gap_at(tip, X.to_local(p)).distance);
        }
    const bool hit = intersects(c, tip, X, 0);
    hits += hit;
    if (nearest < -1e-7) {
      EXPECT_TRUE(hit) << trial;
    }
    if (nearest > 1.8 * edge / n) {
      EXPECT_FALSE(hit) << trial;
    }
  }
  EXPECT_GT(hits, 200);
}

struct Block {
  TissueModel model;
  TissueState state;
  Instrument instrument;

  Block() {
    const TetMesh mesh = box_mesh(Vec3(8e-3, 2e-3, 2e-3), 8, 2, 2);
    const std::vector<int> bottom = mesh.group("bottom")->nodes;
    model = make_tissue_model(mesh, {3000, 0.45, 1000, 0, 0}, bottom, Vec3::Zero());
    state = rest_state(model);
    instrument.primitives = {sphere(3e-4)};
  }
};

TEST(Removal, NearestFirstAndOnlyLive) {
  Block b;
  const Pose X{Vec3(1e-3, 1e-3, 2e-3), Quat::Identity()};
  const std::vector<int> tets = tets_at_tip(b.model, b.state, b.instrument, X, 0);
  ASSERT_FALSE(tets.empty());
  double last = -1;
  for (int e : tets) {
    Vec3 centroid = Vec3::Zero();
    for (int n : b.model.mesh.tets[e]) centroid += 0.25 * b.state.x[n];
    const double gap = (centroid - X.p).norm();
    EXPECT_GE(gap, last - 1e-15);
    last = gap;
  }
  remove_tets(b.model, b.state, std::span(tets).first(1));
  const std::vector<int> left = tets_at_tip(b.model, b.state, b.instrument, X, 0);
  EXPECT_EQ(left.size(), tets.size() - 1);
  EXPECT_EQ(std::count(left.begin(), left.end(), tets[0]), 0);
}

TEST(Removal, SuctionTakesOnlyLooseReachableSmallFragments) {
  const TetMesh mesh = box_mesh(Vec3(8e-3, 1e-3, 1e-3), 8, 1, 1);
  std::vector<int> held;
  for (int n = 0; n < static_cast<int>(mesh.nodes.size()); ++n)
    if (mesh.nodes[n].x() < 1e-6) held.push_back(n);
  Block b;
  b.model = make_tissue_model(mesh, {3000, 0.45, 1000, 0, 0}, held, Vec3::Zero());
  b.state = rest_state(b.model);
  std::vector<int> slice;  // cell 4 of 8: what lies beyond is loose
  int beyond = 0;
  for (int e = 0; e < b.model.tet_count(); ++e) {
    double x = 0;
    for (int n : mesh.tets[e]) x += 0.25 * mesh.nodes[n].x();
    if (x > 4e-3 && x < 5e-3) slice.push_back(e);
    beyond += x > 5e-3;
  }
  const Pose at_end{Vec3(8.2e-3, 5e-4, 5e-4), Quat::Identity()}, far{Vec3(0.02, 0, 0), Quat::Identity()};
  const RemovalSettings settings{0, 0, 1e-3, 1000};
  EXPECT_EQ(fragments_at_tip(b.model, b.state, b.instrument, at_end, settings).fragments, 0);
  remove_tets(b.model, b.state, slice);
  const Aspirated sucked = fragments_at_tip(b.model, b.state, b.instrument, at_end, settings);
  EXPECT_EQ(sucked.fragments, 1);
  EXPECT_EQ(static_cast<int>(sucked.tets.size()), beyond);
  EXPECT_EQ(fragments_at_tip(b.model, b.state, b.instrument, far, settings).fragments, 0);
  EXPECT_EQ(fragments_at_tip(b.model, b.state, b.instrument, at_end, {0, 0, 1e-3, beyond - 1}).fragments, 0);
}

// Of the bar of 1 × 1 mm² what lies beyond the slice is 3 mm long and needs a lumen of 1/√2 mm, however many
// tetrahedra it has; where the port is counts, not the tip.
TEST(Removal, ALumenTakesWhatFitsThroughIt) {
  const TetMesh mesh = box_mesh(Vec3(8e-3, 1e-3, 1e-3), 8, 1, 1);
  std::vector<int> held, slice;
  for (int n = 0; n < static_cast<int>(mesh.nodes.size()); ++n)
    if (mesh.nodes[n].x() < 1e-6) held.push_back(n);
  Block b;
  b.model = make_tissue_model(mesh, {3000, 0.45, 1000, 0, 0}, held, Vec3::Zero());
  b.state = rest_state(b.model);
  for (int e = 0; e < b.model.tet_count(); ++e) {
    double x = 0;
    for (int n : mesh.tets[e]) x += 0.25 * mesh.nodes[n].x();
    if (x > 4e-3 && x < 5e-3) slice.push_back(e);
  }
  remove_tets(b.model, b.state, slice);
  b.instrument.port.direction = -Vec3::UnitX();
  b.instrument.port.position = Vec3(-0.3e-3, 0, 0);
  b.instrument.port.radius = 0.2e-3;
  const Pose at_end{Vec3(8.5e-3, 5e-4, 5e-4), Quat::Identity()};  // the opening 0.2 mm from the end
  const auto sucked = [&](double lumen, double reach, const Pose& X) {
    b.instrument.port.lumen = lumen;
    return fragments_at_tip(b.model, b.state, b.instrument, X, {0, 0, reach, 0});
  };
  const Aspirated fits = sucked(0.72e-3, 0.7e-3, at_end);
  EXPECT_EQ(fits.fragments, 1);
  EXPECT_NEAR(fits.volume, 3e-9, 1e-15);
  EXPECT_EQ(fits.too_wide, 0);
  const Aspirated stuck = sucked(0.69e-3, 0.7e-3, at_end);
  EXPECT_EQ(stuck.fragments, 0);
  EXPECT_TRUE(stuck.tets.empty());
  EXPECT_NEAR(stuck.too_wide, std::sqrt(0.5) * 1e-3, 0.02e-3);
  EXPECT_EQ(sucked(0.72e-3, 0.5e-3, at_end).fragments, 0) << "the corners are 0.55 mm from the opening";
  const Pose turned{at_end.p, Quat(Eigen::AngleAxisd(M_PI, Vec3::UnitZ()))};
  EXPECT_EQ(sucked(0.72e-3, 0.7e-3, turned).fragments, 0) << "it opens the other way";
  EXPECT_TRUE(aspirates(b.instrument, {0, 0, 1e-3, 0}));
  b.instrument.port.lumen = 0;
  EXPECT_FALSE(aspirates(b.instrument, {0, 0, 1e-3, 0}));
}

TEST(Removal, SuctionTakesWhatHangsByAnEdge) {
  TetMesh mesh = box_mesh(Vec3(2e-3, 1e-3, 1e-3), 2, 1, 1);
  std::vector<int> held;
  for (int n = 0; n < static_cast<int>(mesh.nodes.size()); ++n)
    if (mesh.nodes[n].x() < 1e-6) held.push_back(n);
  Block b;
  b.model = make_tissue_model(mesh, {3000, 0.45, 1000, 0, 0}, held, Vec3::Zero());
  b.state = rest_state(b.model);
  // Of the far cell, all but what has no face in common with the near one.
  std::vector<int> gone, hinged;
  for (int e = 0; e < b.model.tet_count(); ++e) {
    double x = 0;
    int shared = 0;
    for (int n : mesh.tets[e]) {
      x += 0.25 * mesh.nodes[n].x();
      shared += std::abs(mesh.nodes[n].x() - 1e-3) < 1e-6;
    }
    if (x < 1e-3) continue;
    (shared == 2 ? hinged : gone).push_back(e);
  }
  ASSERT_FALSE(hinged.empty());
  const Pose at_end{Vec3(2.2e-3, 5e-4, 5e-4), Quat::Identity()};
  const RemovalSettings settings{0, 0, 1.5e-3, 1000};
  EXPECT_EQ(fragments_at_tip(b.model, b.state, b.instrument, at_end, settings).fragments, 0);
  remove_tets(b.model, b.state, gone);
  std::vector<int> sucked = fragments_at_tip(b.model, b.state, b.instrument, at_end, settings).tets;
  std::sort(sucked.begin(), sucked.end());
  EXPECT_EQ(sucked, hinged);
}

}  // namespace
}  // namespace hapticd
