// Where an instrument will be, from where it was.
#include "physics/simulation/step/pose_predictor.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

namespace hapticd {
namespace {

PosePredictor along(const auto& way, int steps) {
  PosePredictor of;
  for (int k = -steps; k <= 0; ++k) of.follow(way(k));
  return of;
}

TEST(PosePredictor, ByHand) {
  // Chords of a step each: east, then north of the same length: the circle goes on to the west, then south.
  PosePredictor of;
  EXPECT_EQ(of.in(3, 1), Vec3(0, 0, 0));
  of.follow(Vec3(0, 0, 5));
  EXPECT_EQ(of.in(3, 1), Vec3(0, 0, 0));
  of.follow(Vec3(1, 0, 5));
  EXPECT_EQ(of.in(3, 1), Vec3(3, 0, 0));  // of two places a line
  of.follow(Vec3(1 + 1e-9, 1, 5));        // a trifle less than a right angle
  EXPECT_LT((of.in(1, 1) - Vec3(-1, 0, 0)).norm(), 1e-8);
  EXPECT_LT((of.in(2, 1) - Vec3(-1, -1, 0)).norm(), 1e-8);
  of.forget();
  EXPECT_EQ(of.in(3, 1), Vec3(0, 0, 0));
}

TEST(PosePredictor, ACircleIsGoneOnExactlyByChordsOfAnyLength) {
  const Eigen::AngleAxisd tilt(0.7, Vec3(1, 2, -1).normalized());
  const auto circle = [&](double k) -> Vec3 {
    return Vec3(3, 1, 2) + tilt * Vec3(1.5 * std::cos(0.04 * k), 1.5 * std::sin(0.04 * k), 0);
  };
  const PosePredictor of = along(circle, 40);
  for (const int chord : {1, 5, 12, 16, 100})
    for (const double steps : {0.0, 1.0, 7.5, 26.0})
      EXPECT_LT((of.in(steps, chord) - (circle(steps) - circle(0))).norm(), 1e-10) << chord << ' ' << steps;
}

TEST(PosePredictor, LinesRestAndTurningBackAreStraight) {
  const PosePredictor line = along([](int k) -> Vec3 { return Vec3(0.1 * k, 0, -0.2 * k); }, 10);
  EXPECT_LT((line.in(20, 4) - Vec3(2, 0, -4)).norm(), 1e-12);
  EXPECT_EQ(along([](int) { return Vec3(1, 1, 1); }, 10).in(20, 4), Vec3(0, 0, 0));
  const PosePredictor back = along([](int k) { return Vec3(std::abs(k + 4), 0, 0); }, 10);
  EXPECT_LT((back.in(6, 4) - Vec3(6, 0, 0)).norm(), 1e-12);
}

}  // namespace
}  // namespace hapticd
