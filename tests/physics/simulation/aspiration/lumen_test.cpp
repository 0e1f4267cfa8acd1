// What passes a lumen: pieces of known shape, any turn, and a search through all directions.
#include "physics/simulation/aspiration/lumen.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace hapticd {
namespace {

using Nodes = std::vector<Vec3>;

Nodes box(double a, double b, double c) {
  Nodes out;
  for (int k = 0; k < 8; ++k) out.emplace_back(k & 1 ? a : 0, k & 2 ? b : 0, k & 4 ? c : 0);
  return out;
}

Nodes rod(double radius, double length) {
  Nodes out;
  for (int k = 0; k < 48; ++k) {
    const double turn = 2 * std::numbers::pi * k / 24;
    out.emplace_back(radius * std::cos(turn), radius * std::sin(turn), k < 24 ? 0 : length);
  }
  return out;
}

Nodes ball_of(double radius) {
  Nodes out;
  for (int k = 0; k < 400; ++k) {
    const double z = 1 - (k + 0.5) / 200, turn = k * std::numbers::pi * (3 - std::sqrt(5.0));
    const double r = std::sqrt(1 - z * z);
    out.push_back(radius * Vec3(r * std::cos(turn), r * std::sin(turn), z));
  }
  return out;
}

Nodes moved(const Nodes& nodes, std::mt19937& random) {
  std::uniform_real_distribution<double> u(-1, 1);
  const Pose X{Vec3(u(random), u(random), u(random)) * 1e-2,
               Quat(u(random), u(random), u(random), u(random)).normalized()};
  Nodes out;
  for (const Vec3& x : nodes) out.push_back(X.to_world(x));
  return out;
}

// A box passes along its longest edge, a rod along its axis, a regular tetrahedron along the line through the
// middles of two opposite edges (Weißbach), wherever and however it lies.
TEST(Lumen, PiecesOfKnownShapeNeedTheirOwnCrossSection) {
  std::mt19937 random(3);
  const double half = 0.5e-3 / std::sqrt(2.0);
  const Nodes tetrahedron = {half * Vec3(1, 1, 1), half * Vec3(1, -1, -1), half * Vec3(-1, 1, -1),
                             half * Vec3(-1, -1, 1)};  // edge: 1 mm
  for (int trial = 0; trial < 40; ++trial) {
    EXPECT_NEAR(passing_radius(moved(box(1e-3, 1e-3, 1e-3), random)), std::sqrt(0.5) * 1e-3, 7e-6);
    EXPECT_NEAR(passing_radius(moved(box(3e-3, 0.4e-3, 0.3e-3), random)), 0.25e-3, 2.5e-6);
    EXPECT_NEAR(passing_radius(moved(rod(0.3e-3, 4e-3), random)), 0.3e-3, 3e-6);
    EXPECT_NEAR(passing_radius(moved(ball_of(0.5e-3), random)), 0.5e-3, 5e-6);
    EXPECT_NEAR(passing_radius(moved(tetrahedron, random)), 0.5e-3, 5e-6);
  }
}

// A slice of little volume does not pass where it is wider than the bore.
TEST(Lumen, ASliceIsAsWideAsItIs) {
  EXPECT_GT(passing_radius(box(2e-3, 2e-3, 0.05e-3), 0.35e-3), 0.35e-3);
  EXPECT_LE(passing_radius(box(2e-3, 0.5e-3, 0.05e-3), 0.35e-3), 0.35e-3);
}

// 20 000 directions, for random pieces: never less than the least, and at most 1 % more.
TEST(Lumen, AgreesWithASearchThroughAllDirections) {
  std::mt19937 random(11);
  std::normal_distribution<double> normal(0, 1);
  for (int trial = 0; trial < 12; ++trial) {
    const Vec3 stretch = Vec3(1, 0.3 + 0.05 * trial, 0.5) * 1e-3;
    Nodes nodes;
    for (int k = 0; k < 4 + 2 * trial; ++k)
      nodes.push_back(stretch.cwiseProduct(Vec3(normal(random), normal(random), normal(random))));
    double least = 1;
    for (int k = 0; k < 20000; ++k) {
      const double z = (k + 0.5) / 20000, turn = k * std::numbers::pi * (3 - std::sqrt(5.0));
      const double r = std::sqrt(1 - z * z);
      const Vec3 d(r * std::cos(turn), r * std::sin(turn), z);
      // The smallest circle's radius from below: half the widest distance. From above: about the middle.
      Nodes flat;
      for (const Vec3& x : nodes) flat.push_back(x - d.dot(x) * d);
      Vec3 centre = flat[0];  // Bădoiu and Clarkson's iteration
      double reach = 0;
      for (int step = 1; step <= 200; ++step) {
        const Vec3* farthest = &flat[0];
        for (const Vec3& x : flat)
          if ((x - centre).squaredNorm() > (*farthest - centre).squaredNorm()) farthest = &x;
        reach = (*farthest - centre).norm();
        centre += (*farthest - centre) / (step + 1);
        if (step == 12 && reach > 1.3 * least) break;
      }
      least = std::min(least, reach);
    }
    const double found = passing_radius(nodes);
    EXPECT_GT(found, 0.985 * least) << trial;  // the iteration is from above, by a percent
    EXPECT_LT(found, 1.01 * least) << trial;
  }
}

// Bounds that spare the search do not change the answer.
TEST(Lumen, TheAnswerDoesNotDependOnHowItIsFound) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(0.2, 2);
  for (int trial = 0; trial < 300; ++trial) {
    const Nodes nodes = moved(box(u(random) * 1e-3, u(random) * 1e-3, u(random) * 1e-3), random);
    const double radius = passing_radius(nodes);
    for (const double lumen : {0.2e-3, 0.5e-3, 0.9e-3, 2e-3})
      EXPECT_EQ(passing_radius(nodes, lumen) <= lumen, radius <= lumen) << trial;
  }
}

TEST(Lumen, DistanceIsToTheDisc) {
  const Port port{Vec3(0, 0, -1e-3), -Vec3::UnitZ(), 0.3e-3};
  EXPECT_NEAR(distance_to_opening(port, Vec3(0.2e-3, 0, -1e-3)), 0, 1e-15);
  EXPECT_NEAR(distance_to_opening(port, Vec3(0.1e-3, 0.1e-3, -1.5e-3)), 0.5e-3, 1e-15);
  EXPECT_NEAR(distance_to_opening(port, Vec3(0.7e-3, 0, -1.3e-3)), 0.5e-3, 1e-15);
}

}  // namespace
}  // namespace hapticd
