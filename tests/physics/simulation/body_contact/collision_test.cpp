// Which triangles are near, and tissue that has gone beyond all bounds.
#include "physics/simulation/body_contact/collision.h"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

namespace hapticd {
namespace {

Instrument ball() {
  Instrument i;
  Primitive p;
  p.radius = 1e-3;
  i.primitives = {p};
  return i;
}

// One triangle of 4 mm below the origin.
struct OneFace {
  std::vector<SurfaceFace> faces{1};
  std::vector<Vec3> x{{-2e-3, -1e-3, -1.5e-3}, {2e-3, -1e-3, -1.5e-3}, {0, 2e-3, -1.5e-3}};
  Instrument instrument = ball();
  Collision collision{instrument, 1e-3};

  OneFace() {
    faces[0].nodes = {0, 1, 2};
    collision.add_body(faces, x);
  }
  std::size_t near() {
    std::vector<NearFace> out;
    collision.near_faces(Pose{}, out);
    return out.size();
  }
};

TEST(Collision, AFaceIsNearWithinTheAlarmDistance) {
  OneFace one;
  EXPECT_EQ(one.near(), 1u);
  for (Vec3& x : one.x) x.z() = -2.1e-3;
  one.collision.refit(0, one.x);
  EXPECT_EQ(one.near(), 0u);
}

// One corner next to the primitive grown by the alarm distance, the others farther away in the same
// direction.
TEST(Collision, ACornerInsideIsNearAndOneOutsideIsNot) {
  constexpr double margin = 1e-3;
  Primitive sphere, capsule, cylinder, box;
  sphere.radius = capsule.radius = cylinder.radius = 1e-3;
  capsule.shape = Shape::capsule;
  cylinder.shape = Shape::cylinder;
  capsule.half_length = cylinder.half_length = 2e-3;
  box.shape = Shape::convex;
  for (const double x : {-1e-3, 1e-3})
    for (const double y : {-1e-3, 1e-3})
      for (const double z : {-1e-3, 1e-3}) box.vertices.push_back(Vec3(x, y, z));
  struct Case {
    Primitive primitive;
    Vec3 direction;
    double reach;  // of the grown primitive that way
  };
  const Vec3 x = Vec3::UnitX(), z = Vec3::UnitZ();
  const Pose placed{Vec3(0.3, -0.2, 0.1), Quat(Eigen::AngleAxisd(1.1, Vec3(1, 2, -1).normalized()))};
  for (const Case& c :
       {Case{sphere, Vec3(1, 2, 2) / 3, 2e-3}, Case{capsule, x, 2e-3}, Case{capsule, z, 4e-3},
        Case{cylinder, x, 2e-3}, Case{cylinder, z, 3e-3}, Case{box, x, 2e-3}, Case{box, -z, 2e-3}}) {
    Instrument instrument;
    instrument.primitives = {c.primitive};
    Collision collision(instrument, margin);
    std::vector<SurfaceFace> faces(2);
    std::vector<Vec3> at;
    const Vec3 aside = c.direction.unitOrthogonal();
    for (int f = 0; f < 2; ++f) {
      faces[f].nodes = {3 * f, 3 * f + 1, 3 * f + 2};
      const double first = c.reach + (f == 0 ? -1e-5 : 1e-5);
      for (const Vec3& corner : {Vec3(first * c.direction), Vec3(2 * c.reach * c.direction),
                                 Vec3(2 * c.reach * c.direction + 1e-3 * aside)})
        at.push_back(placed.to_world(corner));
    }
    collision.add_body(faces, at);
    std::vector<NearFace> out;
    collision.near_faces(placed, out);
    ASSERT_EQ(out.size(), 1u) << static_cast<int>(c.primitive.shape) << ' ' << c.direction.transpose();
    EXPECT_EQ(out[0].face, 0);
  }
}

TEST(Collision, TissueThatHasComeApartIsSaid) {
  OneFace one;
  one.x[1].x() = 3;
  EXPECT_NO_THROW(one.collision.refit(0, one.x));
  one.x[1].x() = 7e7;
  EXPECT_THROW(one.collision.refit(0, one.x), std::runtime_error);
  EXPECT_THROW(one.collision.set_surface(0, one.faces, one.x), std::runtime_error);
  one.x[1].x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(one.collision.refit(0, one.x), std::runtime_error);
}

// What falls is not what bursts.
TEST(Collision, AFaceMayFallAsFarAsItWill) {
  OneFace one;
  for (Vec3& x : one.x) x.z() -= 1e4;
  EXPECT_NO_THROW(one.collision.refit(0, one.x));
  EXPECT_EQ(one.near(), 0u);
}

}  // namespace
}  // namespace hapticd
