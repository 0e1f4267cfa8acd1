#include "physics/simulation/body_contact/vertex_face_contact.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace hapticd {
namespace {

// Two faces that meet along the y axis and fall (angle < 0: a ridge) or rise (a hollow) away from it.
std::vector<ContactFace> wings(double angle) {
  const Vec3 a(0, -1, 0), b(0, 1, 0);
  const Vec3 right(std::cos(angle), 0, std::sin(angle)), left(-right.x(), 0, right.z());
  const Vec3 n_right = Vec3(-right.z(), 0, right.x()), n_left = Vec3(right.z(), 0, right.x());
  ContactFace r, l;
  r.x = {a, right, b};
  l.x = {a, b, left};
  r.edge = {n_right, Vec3::UnitZ(), n_right};  // opposite corner 1 is the shared edge
  l.edge = {n_left, n_left, Vec3::UnitZ()};
  r.corner = {Vec3::UnitZ(), n_right, Vec3::UnitZ()};
  l.corner = {Vec3::UnitZ(), Vec3::UnitZ(), n_left};
  return {r, l};
}

TEST(VertexFaceContact, NearestPointIsNearerThanAnyOther) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(-1, 1);
  const auto point = [&] { return Vec3(u(random), u(random), u(random)); };
  for (int trial = 0; trial < 500; ++trial) {
    const std::array<Vec3, 3> x = {point(), point(), point()};
    const Vec3 p = 2 * point();
    const auto w = nearest_on_triangle(p, x);
    EXPECT_NEAR(w[0] + w[1] + w[2], 1, 1e-12);
    const double found = (p - w[0] * x[0] - w[1] * x[1] - w[2] * x[2]).norm();
    for (int i = 0; i <= 12; ++i)
      for (int j = 0; i + j <= 12; ++j) {
        const double s = i / 12.0, t = j / 12.0;
        EXPECT_LE(found, (p - (1 - s - t) * x[0] - s * x[1] - t * x[2]).norm() + 1e-12);
      }
  }
}

TEST(VertexFaceContact, AboveAFaceTheGapIsItsHeightAndBelowItsDepth) {
  const auto faces = wings(0);
  std::array<VertexFaceContact, max_vertex_face_contacts> out;
  for (const double z : {0.2, 1e-9, -1e-9, -0.2}) {
    ASSERT_EQ(find_vertex_face_contacts(Vec3(0.3, 0.1, z), faces, 1e-3, -1, out),
              1);  // two faces of one plane are one touch
    EXPECT_NEAR(out[0].gap, z, 1e-15);
    EXPECT_NEAR(out[0].normal.z(), 1, 1e-15);
  }
}

// A point that nearly lies on a ridge: the direction to it turns at random, its normal must not.
TEST(VertexFaceContact, NormalsDoNotChatterOnARidge) {
  const auto faces = wings(-30 * std::numbers::pi / 180);
  std::array<VertexFaceContact, max_vertex_face_contacts> out;
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 1e-9);
  Vec3 before = Vec3::UnitZ();
  for (int i = 0; i < 1000; ++i) {
    const int count =
        find_vertex_face_contacts(Vec3(noise(random), 0.1, std::abs(noise(random))), faces, 1e-3, -1, out);
    ASSERT_EQ(count, 1);
    EXPECT_GT(out[0].normal.dot(before), std::cos(31 * std::numbers::pi / 180));
    EXPECT_LT(std::abs(out[0].gap), 1e-8);
  }
  // From outside the sign is that of the ridge's pseudo-normal, for every direction between the faces'
  // normals.
  for (const double tilt : {-0.5, -0.2, 0.0, 0.3, 0.5}) {
    const Vec3 away(std::sin(tilt), 0, std::cos(tilt));
    find_vertex_face_contacts(Vec3(0, 0.1, 0) + 0.05 * away, faces, 1e-3, -1, out);
    EXPECT_NEAR(out[0].gap, 0.05, 1e-12);
    EXPECT_NEAR(out[0].normal.dot(away), 1, 1e-12);
  }
}

TEST(VertexFaceContact, InAHollowBothFacesTouchOnEitherSideOfTheEdge) {
  const double angle = 30 * std::numbers::pi / 180;
  const auto faces = wings(angle);
  std::array<VertexFaceContact, max_vertex_face_contacts> out;
  for (const double x : {-1e-3, -1e-9, 0.0, 1e-9, 1e-3})
    for (const double z : {0.02, 1e-6, -1e-6, -0.02}) {
      ASSERT_EQ(find_vertex_face_contacts(Vec3(x, 0, z), faces, 1e-4, -1, out), 2) << x << ' ' << z;
      for (int k = 0; k < 2; ++k) {
        const double side = out[k].face == 0 ? 1 : -1;
        EXPECT_NEAR(out[k].gap, z * std::cos(angle) - side * x * std::sin(angle), 1e-12);
      }
    }
  // Far out on one wing it is the only one.
  EXPECT_EQ(find_vertex_face_contacts(Vec3(0.8, 0, 0.8 * std::tan(angle) + 0.01), faces, 1e-4, -1, out), 1);
}

TEST(VertexFaceContact, AFaceThatHeldAPointHoldsItALittleBeyondItsEdge) {
  const auto faces = wings(-30 * std::numbers::pi / 180);
  std::array<VertexFaceContact, max_vertex_face_contacts> out;
  for (const double x : {0.01, -0.005, -0.1}) {
    find_vertex_face_contacts(Vec3(x, 0, -0.3 * x - 1e-6), faces, 1e-4, 0, out);
    EXPECT_EQ(out[0].face, x > -0.02 ? 0 : 1) << x;
  }
}

TEST(VertexFaceContact, NoFacesNoTouch) {
  std::array<VertexFaceContact, max_vertex_face_contacts> out;
  EXPECT_EQ(find_vertex_face_contacts(Vec3::Zero(), {}, 1e-3, -1, out), 0);
}

}  // namespace
}  // namespace hapticd
