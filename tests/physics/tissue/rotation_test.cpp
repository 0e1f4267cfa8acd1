#include "physics/tissue/rotation.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/physics/tissue/random_shapes.h"

namespace hapticd {
namespace {

double alignment(const Mat3& R, const Mat3& F) { return R.cwiseProduct(F).sum(); }

void expect_rotation(const Mat3& R) {
  EXPECT_LT((R.transpose() * R - Mat3::Identity()).norm(), 1e-13);
  EXPECT_GT(R.determinant(), 0);
}

// Independent reference: Eigen's SVD with the last direction flipped where needed.
Mat3 reference_rotation(const Mat3& F) {
  const Eigen::JacobiSVD<Mat3> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Vec3 sign(1, 1, (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1);
  return svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
}

double angle_between(const Mat3& A, const Mat3& B) {
  return 2 * std::asin(std::min(1.0, (A - B).norm() / std::sqrt(8.0)));
}

TEST(NearestRotation, RecoversTheRotationOfAStretchedElement) {
  std::mt19937 random(1);
  for (int i = 0; i < 1000; ++i) {
    const Mat3 R = random_rotation(random);
    const Mat3 Q = random_rotation(random);
    const Mat3 stretch = Q * (Vec3::Constant(1.2) + random_vector(random, 1.0)).asDiagonal() * Q.transpose();
    EXPECT_LT((nearest_rotation(R * stretch, Mat3::Identity()) - R).norm(), 1e-12);
  }
}

// Any lane may be inverted, flat, or not a number: the others do not feel it.
TEST(NearestRotation, SideBySideAsOneByOne) {
  std::mt19937 random(7);
  std::uniform_int_distribution<int> kind(0, 9);
  for (int trial = 0; trial < 3000; ++trial) {
    std::array<Mat3, element_lanes> F, start, result;
    std::array<Mat3*, element_lanes> R;
    for (int l = 0; l < element_lanes; ++l) {
      const Mat3 turn = random_rotation(random);
      start[l] = turn;
      switch (kind(random)) {
        case 0:
          F[l] = random_matrix(random, 1.0);
          break;  // often inverted
        case 1:
          F[l] = turn * Vec3(1, 1, 0).asDiagonal();
          break;  // flat
        case 2:
          F[l] = Mat3::Constant(std::numeric_limits<double>::quiet_NaN());
          break;
        case 3:
          F[l].setZero();
          break;
        default:
          F[l] = turn * (Mat3::Identity() + random_matrix(random, 0.2));
          break;  // as in a step
      }
      result[l] = start[l];
      R[l] = &result[l];
    }
    Lanes3x3 lanes;
    for (int l = 0; l < element_lanes; ++l) lanes.set(l, F[l].data());
    nearest_rotations(lanes, R);
    for (int l = 0; l < element_lanes; ++l)
      ASSERT_LT((result[l] - nearest_rotation(F[l], start[l])).norm(), 1e-10) << F[l];
  }
}

TEST(NearestRotation, AgreesWithSvdFromAnyStartInvertedOrNot) {
  std::mt19937 random(2);
  int inverted = 0;
  for (int i = 0; i < 20000; ++i) {
    const Mat3 F = random_matrix(random, 1.0);
    const Mat3 reference = reference_rotation(F);
    inverted += F.determinant() < 0;
    const Mat3 R = nearest_rotation(F, random_rotation(random));
    expect_rotation(R);
    // The value is what is unique; the argument only as far as the Hessian σ₂ + σ₃ allows.
    EXPECT_NEAR(alignment(R, F), alignment(reference, F), 1e-13 * F.norm());
    const Vec3 sigma = Eigen::JacobiSVD<Mat3>(F).singularValues();
    const double curvature = sigma[1] + std::copysign(sigma[2], F.determinant());
    EXPECT_LT((R - reference).norm(), 1e-13 * F.norm() / curvature + 1e-12);
  }
  EXPECT_GT(inverted, 5000);
}

TEST(NearestRotation, ReflectedElementKeepsItsTwoLongerAxes) {
  const Mat3 mirrored = Vec3(1.0, 0.9, -0.3).asDiagonal();
  EXPECT_LT((nearest_rotation(mirrored, Mat3::Identity()) - Mat3::Identity()).norm(), 1e-14);
  EXPECT_LT((nearest_rotation_by_svd(mirrored, Mat3::Identity()) - Mat3::Identity()).norm(), 1e-14);
  // −I: every half turn is nearest, and so is nothing better than tr = 1.
  const Mat3 R = nearest_rotation(-Mat3::Identity(), Mat3::Identity());
  expect_rotation(R);
  EXPECT_NEAR(alignment(R, -Mat3::Identity()), 1.0, 1e-12);
}

TEST(NearestRotation, FlattenedToAPlaneALineAndAPoint) {
  std::mt19937 random(3);
  for (int i = 0; i < 200; ++i) {
    const Mat3 U = random_rotation(random);
    const Mat3 V = random_rotation(random);
    const Mat3 plane = U * Vec3(1.3, 0.6, 0.0).asDiagonal() * V.transpose();
    EXPECT_LT((nearest_rotation(plane, random_rotation(random)) - U * V.transpose()).norm(), 1e-12);

    const Mat3 start = random_rotation(random);
    const Mat3 line = U.col(0) * V.col(0).transpose();
    const Mat3 R = nearest_rotation(line, start);
    expect_rotation(R);
    EXPECT_LT((R * V.col(0) - U.col(0)).norm(), 1e-10);
    // Of all rotations that carry V₁ to U₁, the nearest to the start is the smallest turn from it.
    const Vec3 from = start * V.col(0);
    const Mat3 smallest = Quat::FromTwoVectors(from, U.col(0)).toRotationMatrix() * start;
    EXPECT_GE(alignment(R, start), alignment(smallest, start) - 1e-9);

    EXPECT_EQ(nearest_rotation(Mat3::Zero(), start), start);
  }
}

TEST(NearestRotation, NotANumberLeavesTheStart) {
  Mat3 F = Mat3::Identity();
  F(1, 2) = std::numeric_limits<double>::quiet_NaN();
  const Mat3 start = Eigen::AngleAxisd(0.3, Vec3::UnitX()).toRotationMatrix();
  EXPECT_EQ(nearest_rotation(F, start), start);
  F(1, 2) = std::numeric_limits<double>::infinity();
  EXPECT_EQ(nearest_rotation(F, start), start);
}

// Squeezed through itself and back while turning: R follows the turn and never jumps.
TEST(NearestRotation, FollowsAnElementThroughInversionWithoutAJump) {
  std::mt19937 random(4);
  for (int path = 0; path < 50; ++path) {
    const Mat3 U = random_rotation(random);
    const Vec3 axis = random_vector(random, 1.0).normalized();
    Mat3 R = U;
    const int steps = 400;
    for (int k = 0; k <= steps; ++k) {
      const double t = double(k) / steps;
      const Mat3 turn = Eigen::AngleAxisd(2.0 * t, axis).toRotationMatrix() * U;
      const Mat3 F = turn * Vec3(1.0, 0.9 + 0.3 * t, std::cos(2.4 * t)).asDiagonal();  // down to −0.74
      const Mat3 next = nearest_rotation(F, R);
      EXPECT_LT(angle_between(next, R), 2.5 * 2.0 / steps);
      EXPECT_LT((next - turn).norm(), 1e-11);
      R = next;
    }
  }
}

// Straight paths through the space of matrices: where σ₂ + σ₃ stays away from 0, so does any jump.
TEST(NearestRotation, IsLipschitzAlongRandomPaths) {
  std::mt19937 random(5);
  int checked = 0;
  for (int path = 0; path < 200; ++path) {
    const Mat3 from = Mat3::Identity() + random_matrix(random, 0.7);
    const Mat3 to = Mat3::Identity() + random_matrix(random, 1.4);
    const int steps = 500;
    Mat3 R = nearest_rotation(from, Mat3::Identity());
    for (int k = 1; k <= steps; ++k) {
      const Mat3 F = from + (to - from) * (double(k) / steps);
      const Mat3 next = nearest_rotation(F, R);
      const Vec3 sigma = Eigen::JacobiSVD<Mat3>(F).singularValues();
      const double curvature = sigma[1] + std::copysign(sigma[2], F.determinant());
      const double moved = (to - from).norm() / steps;
      if (curvature > 10 * moved) {
        // |dR| ≤ 2 |dF| / (σ₂ + σ₃), with room for the curvature's change within the step.
        EXPECT_LT((next - R).norm(), 2.5 * moved / curvature);
        ++checked;
      }
      R = next;
    }
  }
  EXPECT_GT(checked, 50000);
}

TEST(NearestRotation, StaysARotationOverAHundredThousandWarmSteps) {
  std::mt19937 random(6);
  Mat3 R = Mat3::Identity();
  Mat3 turn = Mat3::Identity();
  const Mat3 step = Eigen::AngleAxisd(0.01, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  for (int k = 0; k < 100000; ++k) {
    turn = step * turn;
    R = nearest_rotation(turn * Vec3(1.1, 0.8, -0.2).asDiagonal(), R);
  }
  expect_rotation(R);
}

}  // namespace
}  // namespace hapticd
