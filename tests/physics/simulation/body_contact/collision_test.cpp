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
