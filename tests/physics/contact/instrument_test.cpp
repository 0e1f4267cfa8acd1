#include "physics/contact/instrument.h"

#include <gtest/gtest.h>

#include "tests/support/contact_problems.h"

namespace hapticd {
namespace {

Primitive round_primitive(Shape shape, double radius, double half_length) {
  Primitive p;
  p.shape = shape;
  p.radius = radius;
  p.half_length = half_length;
  return p;
}

// A point of the surface: f runs from the top's pole (0) over the wall to the bottom's pole (1).
Vec3 surface_point(const Primitive& p, double f, const Vec3& around) {
  const Vec3 end(0, 0, p.half_length);
  if (f > 1.0 / 3 && f < 2.0 / 3) return p.radius * around + (3 - 6 * f) * end;
  const double side = f < 0.5 ? 1 : -1, from_pole = 3 * (f < 0.5 ? f : 1 - f);
  if (p.shape == Shape::cylinder) return from_pole * p.radius * around + side * end;
  const double polar = from_pole * M_PI / 2;
  return p.radius * (std::sin(polar) * around + side * std::cos(polar) * Vec3::UnitZ()) + side * end;
}

double sampled_distance(const Primitive& p, const Vec3& x) {
  constexpr int around = 360, along = 450;
  double best = 1e9;
  for (int i = 0; i < around; ++i) {
    const double angle = 2 * M_PI * i / around;
    for (int k = 0; k <= along; ++k)
      best = std::min(best, (surface_point(p, static_cast<double>(k) / along,
                                           {std::cos(angle), std::sin(angle), 0}) - x).norm());
  }
  return best;
}

TEST(Gap, MatchesTheNearestOfManySurfacePoints) {
  Random random(1);
  for (const Shape shape : {Shape::sphere, Shape::capsule, Shape::cylinder}) {
    const Primitive p = round_primitive(shape, 1.0, shape == Shape::sphere ? 0.0 : 0.8);
    for (int trial = 0; trial < 20; ++trial) {
      const Vec3 x = uniform(random, 0.1, 2.2) * unit_vector(random);
      const double distance = sampled_distance(p, x);
      // Samples are 1.8e-2 apart at most: a near one is within 1.5e-2 of the nearest point.
      EXPECT_GE(std::abs(gap_at(p, x).distance), std::sqrt(std::max(0.0, distance * distance - 2.25e-4)));
      EXPECT_LE(std::abs(gap_at(p, x).distance), distance + 1e-12);
    }
  }
}

TEST(Gap, SignsAndHandValues) {
  const Primitive c = round_primitive(Shape::cylinder, 1.0, 2.0);
  EXPECT_DOUBLE_EQ(gap_at(c, {0, 0, 2.5}).distance, 0.5);          // above the flat end
  EXPECT_DOUBLE_EQ(gap_at(c, {4, 0, 6}).distance, 5.0);            // 3-4-5 from the rim
  EXPECT_DOUBLE_EQ(gap_at(c, {0.75, 0, 0}).distance, -0.25);       // inside, wall nearest
  EXPECT_DOUBLE_EQ(gap_at(c, {0, 0.1, -1.9}).distance, -(2 - 1.9));  // inside, end nearest
  const Primitive s = round_primitive(Shape::capsule, 1.0, 2.0);
  EXPECT_DOUBLE_EQ(gap_at(s, {0, 0, 3.5}).distance, 0.5);
  EXPECT_DOUBLE_EQ(gap_at(s, {3, 0, 1}).distance, 2.0);
  EXPECT_DOUBLE_EQ(gap_at(s, {0.5, 0, 1}).distance, -0.5);
}

TEST(Gap, DegeneratePlacesHaveAFiniteUnitNormal) {
  const Primitive convex = make_convex(
      "octahedron", {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}, {});
  for (const Primitive& p :
       {round_primitive(Shape::sphere, 1, 0), round_primitive(Shape::capsule, 1, 2),
        round_primitive(Shape::cylinder, 1, 2), round_primitive(Shape::cylinder, 2, 1), convex})
    for (const Vec3& x : {Vec3(0, 0, 0), Vec3(0, 0, 1), Vec3(0, 0, 2), Vec3(0, 0, -2), Vec3(1, 0, 2),
                          Vec3(1e-320, 0, 0)}) {
      const Gap gap = gap_at(p, x);
      EXPECT_TRUE(std::isfinite(gap.distance));
      EXPECT_NEAR(gap.normal.norm(), 1.0, 1e-12);
    }
}

Instrument placed_instrument(Random& random) {
  Instrument instrument;
  for (const Shape shape : {Shape::sphere, Shape::capsule, Shape::cylinder}) {
    Primitive p = round_primitive(shape, uniform(random, 0.3, 0.6), uniform(random, 0.2, 0.8));
    p.placement = {unit_vector(random), random_rotation(random)};
    instrument.primitives.push_back(p);
  }
  std::vector<Vec3> corners;
  for (int k = 0; k < 12; ++k) corners.push_back(0.7 * unit_vector(random));
  instrument.primitives.push_back(
      make_convex("gem", corners, {unit_vector(random), random_rotation(random)}));
  return instrument;
}

TEST(Gap, NormalIsTheGradientInWorldAxes) {
  Random random(2);
  int checked = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const Instrument instrument = placed_instrument(random);
    const Pose X{unit_vector(random), random_rotation(random)};
    const Vec3 x = X.to_world(uniform(random, 0.2, 2.5) * unit_vector(random));
    const Gap gap = gap_at(instrument, X, x);
    const double h = 1e-6;
    Vec3 gradient;
    bool smooth = true;  // away from the surfaces where the nearest feature changes
    for (int c = 0; c < 3; ++c) {
      const Gap up = gap_at(instrument, X, x + h * Vec3::Unit(c));
      const Gap down = gap_at(instrument, X, x - h * Vec3::Unit(c));
      smooth = smooth && (up.normal - down.normal).norm() < 1e-4;
      gradient[c] = (up.distance - down.distance) / (2 * h);
    }
    if (!smooth) continue;
    ++checked;
    EXPECT_LT((gradient - gap.normal).norm(), 1e-6);
  }
  EXPECT_GT(checked, 280);
}

TEST(Gap, UnionTakesTheNearestPrimitiveAndNamesIt) {
  Instrument instrument = sphere_instrument(1.0);
  instrument.primitives.push_back(round_primitive(Shape::sphere, 0.5, 0));
  instrument.primitives[1].placement.p = {0, 0, 3};
  const Pose X{{1, 2, 3}, Quat(Eigen::AngleAxisd(M_PI / 2, Vec3::UnitY()))};  // local z becomes world x
  const Gap gap = gap_at(instrument, X, Vec3(1 + 4, 2, 3));
  EXPECT_EQ(gap.primitive, 1);
  EXPECT_NEAR(gap.distance, 0.5, 1e-12);
  EXPECT_NEAR((gap.normal - Vec3::UnitX()).norm(), 0, 1e-12);
}

// h(d) = max over the set of d·x: no point inside goes beyond it, and the support point lies on the surface.
TEST(Support, IsTheFarthestPoint) {
  Random random(3);
  for (int trial = 0; trial < 20; ++trial) {
    const Instrument instrument = placed_instrument(random);
    const Pose X{unit_vector(random), random_rotation(random)};
    for (const Primitive& p : instrument.primitives) {
      Instrument alone;
      alone.primitives.push_back(p);
      const Vec3 d = unit_vector(random);
      const Vec3 far = support(p, X, d);
      EXPECT_NEAR(gap_at(alone, X, far).distance, 0, 1e-9);
      for (int k = 0; k < 400; ++k) {
        const Vec3 x = X.to_world(p.placement.to_world(2 * uniform(random, 0, 1) * unit_vector(random)));
        if (gap_at(alone, X, x).distance < 0) {
          EXPECT_LE(d.dot(x), d.dot(far) + 1e-9);
        }
      }
    }
  }
}

TEST(MakeConvex, CubeHasSixFacesAndEightVerticesWhateverLiesInsideOrOnIt) {
  std::vector<Vec3> points;
  for (int i = -1; i <= 1; ++i)
    for (int j = -1; j <= 1; ++j)
      for (int k = -1; k <= 1; ++k)
        points.emplace_back(2e-3 * i, 1e-3 * j, 1e-3 * k);  // also mid-edges, mid-faces and the centre
  points.push_back(points.front());
  const Primitive cube = make_convex("cube", points, {});
  EXPECT_EQ(cube.planes.size(), 6u);
  EXPECT_EQ(cube.vertices.size(), 8u);
  EXPECT_NEAR(gap_at(cube, {0, 0, 0}).distance, -1e-3, 1e-15);
  EXPECT_NEAR(gap_at(cube, {5e-3, 0, 0}).distance, 3e-3, 1e-15);
}

TEST(MakeConvex, RandomHullsHoldTheirPointsAndSatisfyEuler) {
  Random random(4);
  for (int trial = 0; trial < 30; ++trial) {
    std::vector<Vec3> points;
    for (int k = 0; k < 24; ++k) points.push_back(1e-3 * uniform(random, 0.5, 1) * unit_vector(random));
    const Primitive p = make_convex("gem", points, {});
    for (const Vec3& x : points) EXPECT_LE(gap_at(p, x).distance, 1e-11);
    for (const Vec3& v : p.vertices) EXPECT_NEAR(gap_at(p, v).distance, 0, 1e-11);
    EXPECT_EQ(p.planes.size(), 2 * p.vertices.size() - 4);  // a simplicial polyhedron: F = 2V − 4
  }
}

TEST(MakeConvex, RefusesFlatAndTooFewPoints) {
  EXPECT_THROW(make_convex("flat", {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {2, 1, 0}}, {}),
               std::invalid_argument);
  EXPECT_THROW(make_convex("line", {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}}, {}), std::invalid_argument);
  EXPECT_THROW(make_convex("none", {}, {}), std::invalid_argument);
}

}  // namespace
}  // namespace hapticd
