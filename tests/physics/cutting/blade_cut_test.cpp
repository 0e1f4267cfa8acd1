#include "physics/cutting/blade_cut.h"

#include <array>
#include <cmath>
#include <functional>

#include "tests/physics/cutting/cut_body.h"
#include "tests/support/malloc_guard.h"

namespace hapticd {
namespace {

CutStatus extend(CutBody& body, BladeCut& cut, const SweptSurface& strip) {
  body.change.clear();
  const CutStatus status = cut.extend(body.model, body.state, body.work, strip, body.change);
  body.surface.follow(body.model, body.change.tets, body.change.opened);
  return status;
}

// A square of the plane through p with this normal, of half side L.
SweptSurface square(const Vec3& p, const Vec3& normal, double L) {
  const Vec3 u = normal.unitOrthogonal();
  const Vec3 v = normal.normalized().cross(u);
  SweptSurface strip(1);
  const std::array<Vec3, 2> from = {p - L * u - L * v, p + L * u - L * v};
  const std::array<Vec3, 2> to = {p - L * u + L * v, p + L * u + L * v};
  strip.sweep(from, to);
  return strip;
}

// y from −1 to 2, x from `from` to `to`, at height z(x): the normal is up.
SweptSurface sheet(double from, double to, const std::function<double(double)>& z) {
  SweptSurface strip(8);
  const std::array<Vec3, 2> a = {Vec3(from, 2, z(from)), Vec3(from, -1, z(from))};
  const std::array<Vec3, 2> b = {Vec3(to, 2, z(to)), Vec3(to, -1, z(to))};
  strip.sweep(a, b);
  return strip;
}

// The vector area of the faces that opened, of the sides that look up.
Vec3 opened_area(const CutBody& body) {
  const std::vector<int> fragment = label_fragments(body.model, body.state);
  Vec3 sum = Vec3::Zero();
  for (const SurfaceFace& face : body.surface.faces()) {
    const Vec3& a = body.model.mesh.nodes[face.nodes[0]];
    const Vec3 area =
        0.5 * (body.model.mesh.nodes[face.nodes[1]] - a).cross(body.model.mesh.nodes[face.nodes[2]] - a);
    const bool whole = *std::max_element(fragment.begin(), fragment.end()) == 0;
    if (face.cut && (whole ? area.z() > 0 : fragment[face.id / 4] == 0)) sum += area;
  }
  return sum;
}

// No fragment has nodes off the surface on both of its sides.
template <typename Height>
void expect_separated(const CutBody& body, const BladeCut& cut, const Height& height) {
  for (const Fragment& fragment : find_fragments(body.model, body.state)) {
    bool above = false, below = false;
    for (const int t : fragment.tets)
      for (const int n : body.model.mesh.tets[t]) {
        if (cut.on_surface(n)) continue;
        (height(body.model.mesh.nodes[n]) > 0 ? above : below) = true;
      }
    EXPECT_FALSE(above && below);
  }
}

TEST(SweptSurface, CrossingAndSideOfASquare) {
  const SweptSurface strip = square({0, 0, 1}, {0, 0, 2}, 1);
  EXPECT_NEAR(*strip.crossing({0, 0, 0}, {0, 0, 4}), 0.25, 1e-15);
  EXPECT_NEAR(*strip.crossing({0.3, -0.2, 4}, {0.3, -0.2, 0}), 0.75, 1e-15);
  EXPECT_FALSE(strip.crossing({5, 0, 0}, {5, 0, 4}));
  EXPECT_FALSE(strip.crossing({0, 0, 2}, {0, 0, 4}));
  EXPECT_FALSE(strip.crossing({-0.5, 0, 1}, {0.5, 0, 1}));  // in it
  EXPECT_EQ(*strip.crossing({0, 0, 1}, {0, 0, 4}), 0);
  EXPECT_GT(strip.side({0.2, 0.1, 1.1}), 0);
  EXPECT_LT(strip.side({3, 0.1, 0.9}), 0);
}

// A linear function has any values at the corners, so its zero plane crosses any of the patterns.
TEST(BladeCut, EveryPatternOfOneTetrahedron) {
  TetMesh mesh;
  mesh.nodes = {
      {0, 0, 0}, {1, 0, 0}, {0.5, std::sqrt(0.75), 0}, {0.5, std::sqrt(1.0 / 12), std::sqrt(2.0 / 3)}};
  mesh.tets = {{0, 1, 2, 3}};
  int cuts = 0;
  for (int pattern = 0; pattern < 81; ++pattern) {
    const std::array<int, 4> d = {pattern % 3 - 1, pattern / 3 % 3 - 1, pattern / 9 % 3 - 1,
                                  pattern / 27 - 1};
    const int above = static_cast<int>(std::count(d.begin(), d.end(), 1));
    const int below = static_cast<int>(std::count(d.begin(), d.end(), -1));
    if (above + below == 0 || above == 4 || below == 4) continue;
    CutBody body{mesh, {20, 20}};
    Vec3 g = Vec3::Zero();
    for (int c = 0; c < 4; ++c) g += d[c] * body.model.gradients[0].col(c);
    const double at_origin = d[0];  // node 0
    BladeCut cut(body.model);
    (void)extend(body, cut, square(-at_origin / g.squaredNorm() * g, g, 10));
    EXPECT_EQ(body.check(), "") << pattern;
    const bool crosses = above > 0 && below > 0;
    EXPECT_EQ(body.pieces(), crosses ? 2 : 1) << pattern;
    static constexpr std::array<int, 5> elements = {1, 2, 3, 4, 6};
    EXPECT_EQ(body.model.tets_in_use, elements[above * below]) << pattern;
    cuts += crosses;
    expect_separated(body, cut, [&](const Vec3& X) { return g.dot(X) + at_origin; });
  }
  EXPECT_EQ(cuts, 50);  // 81 − 2·16 + 1
}

// Any set of edges may be crossed where a surface ends inside: each is split in turn.
TEST(BladeCut, EverySetOfSplitEdgesOfTwoTetrahedra) {
  for (int set = 0; set < 512; ++set) {
    TetMesh mesh;
    mesh.nodes = {{0, 0, 0}, {1, 0, 0}, {0.5, 0.9, 0}, {0.5, 0.3, 0.8}, {0.5, 0.3, -0.8}};
    mesh.tets = {{0, 1, 2, 3}, {0, 2, 1, 4}};
    CutBody body{std::move(mesh), {20, 100}};
    const double volume = body.volume();
    int edge = 0;
    for (int a = 0; a < 5; ++a)
      for (int b = a + 1; b < 5; ++b) {
        if (a == 3 && b == 4) continue;
        if (set >> edge++ & 1) {
          ASSERT_EQ(body.split(a, b, 0.5), CutStatus::done);
        }
      }
    ASSERT_EQ(body.check(), "") << set;
    EXPECT_NEAR(body.volume(), volume, 1e-15);
  }
}

// The rim of the opened surface is on the box's walls, which are upright: its shadow is the box's section.
TEST(BladeCut, ALevelPlaneMakesTwoPiecesAndItsShadowIsTheSection) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    TetMesh mesh = box_mesh({1, 1, 1}, 4, 4, 4, seed % 2 ? 5 : 6);
    jitter_interior(mesh, {1, 1, 1}, 0.06, seed);
    CutBody body{std::move(mesh), {2000, 10000}};
    const double volume = body.volume();
    const double quality = least_quality(body.model, body.state);
    BladeCut cut(body.model);
    const double z = 0.2 + 0.03 * seed;
    EXPECT_EQ(extend(body, cut, square({0.5, 0.5, z}, {0, 0, 1}, 3)), CutStatus::done);
    EXPECT_EQ(body.check(), "") << seed;
    EXPECT_EQ(body.fragments(), 2) << seed;
    EXPECT_EQ(body.pieces(), 2) << seed;
    EXPECT_NEAR(opened_area(body).z(), 1, 1e-12);
    EXPECT_NEAR(body.volume(), volume, 1e-9);
    EXPECT_GE(least_quality(body.model, body.state), std::min(0.05, quality));
    expect_separated(body, cut, [&](const Vec3& X) { return X.z() - z; });
  }
}

TEST(BladeCut, StripByStripGoesOnFromWhereItEnded) {
  const auto bend = [](double x) { return 0.47 + 0.1 * std::sin(2 * x); };
  for (const double step : {0.031, 0.11, 0.4}) {
    TetMesh mesh = box_mesh({1, 1, 1}, 4, 4, 4, 6);
    jitter_interior(mesh, {1, 1, 1}, 0.06, 5);
    CutBody body{std::move(mesh), {2000, 10000}};
    BladeCut cut(body.model);
    double area = 0;
    for (double x = -0.01; x < 1.05; x += step) {
      EXPECT_NE(extend(body, cut, sheet(x, x + step, bend)), CutStatus::no_room);
      ASSERT_EQ(body.check(), "") << x;
      EXPECT_GE(body.cut_area(), area - 1e-12);  // what is open stays open
      area = body.cut_area();
      if (x + step < 0.7) {
        EXPECT_EQ(body.pieces(), 1) << x;
      }
    }
    EXPECT_EQ(body.fragments(), 2);
    expect_separated(body, cut, [&](const Vec3& X) { return X.z() - bend(X.x()); });
  }
}

TEST(BladeCut, ACutThatEndsInsideOpensWhatItReached) {
  for (const double end : {0.2, 0.45, 0.6, 0.83}) {
    TetMesh mesh = box_mesh({1, 1, 1}, 6, 6, 6, 6);
    jitter_interior(mesh, {1, 1, 1}, 0.03, 2);
    CutBody body{std::move(mesh), {4000, 20000}};
    BladeCut cut(body.model);
    EXPECT_EQ(extend(body, cut, sheet(-0.5, end, [](double) { return 0.44; })), CutStatus::done);
    EXPECT_EQ(body.check(), "");
    EXPECT_EQ(body.pieces(), 1);
    const double shadow = opened_area(body).z();
    EXPECT_LT(shadow, end + 0.25 * std::sqrt(3) / 6);  // snapped ahead by a quarter edge at most
    EXPECT_GT(shadow, end - 2.0 / 6);                  // the element it ends in stays joined
  }
}

TEST(BladeCut, ASecondCutCrossesTheFirst) {
  TetMesh mesh = box_mesh({1, 1, 1}, 4, 4, 4, 6);
  jitter_interior(mesh, {1, 1, 1}, 0.06, 8);
  CutBody body{std::move(mesh), {4000, 20000}};
  BladeCut cut(body.model);
  EXPECT_EQ(extend(body, cut, square({0.5, 0.5, 0.41}, {0, 0, 1}, 3)), CutStatus::done);
  cut.start();
  EXPECT_EQ(extend(body, cut, square({0.57, 0.5, 0.5}, {1, 0, 0}, 3)), CutStatus::done);
  EXPECT_EQ(body.check(), "");
  EXPECT_EQ(body.fragments(), 4);
  EXPECT_EQ(body.pieces(), 4);
}

TEST(BladeCut, WithoutRoomTheBodyIsWhole) {
  for (const MeshRoom room : {MeshRoom{0, 0}, MeshRoom{10, 1000}, MeshRoom{1000, 50}, MeshRoom{40, 1000}}) {
    CutBody body{box_mesh({1, 1, 1}, 3, 3, 3, 6), room};
    BladeCut cut(body.model);
    EXPECT_EQ(extend(body, cut, square({0.5, 0.5, 0.5}, {0, 0, 1}, 3)), CutStatus::no_room);
    EXPECT_EQ(body.check(), "");
    EXPECT_EQ(body.pieces(), 1);
    EXPECT_EQ(body.cut_area(), 0);
  }
}

TEST(BladeCut, AllocatesNothing) {
  if (!MallocGuard::available()) GTEST_SKIP() << "a sanitizer owns malloc";
  CutBody body{box_mesh({1, 1, 1}, 4, 4, 4, 6), {2000, 10000}};
  BladeCut cut(body.model);
  const SweptSurface strip = square({0.5, 0.5, 0.4}, {0.1, 0.2, 1}, 3);
  const MallocGuard guard;
  EXPECT_EQ(extend(body, cut, strip), CutStatus::done);
  EXPECT_EQ(guard.allocations(), 0);
}

}  // namespace
}  // namespace hapticd
