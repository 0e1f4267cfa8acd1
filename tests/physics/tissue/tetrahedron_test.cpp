#include "physics/tissue/tetrahedron.h"

#include <gtest/gtest.h>

#include "physics/tissue/rotation.h"
#include "tests/physics/tissue/random_shapes.h"

namespace hapticd {
namespace {

constexpr double mu = 1034.0;
constexpr double lambda = 9310.0;

struct Element {
  Corners rest;
  RestShape shape;
};

Element random_element(std::mt19937& random) {
  Element e;
  do {
    for (int a = 0; a < 4; ++a) e.rest.col(a) = random_vector(random, 1e-3);
    e.shape = rest_shape(e.rest.col(0), e.rest.col(1), e.rest.col(2), e.rest.col(3));
  } while (e.shape.volume < 1e-10);
  return e;
}

double energy_at(const Element& e, const Corners& x) {
  const Mat3 F = deformation_gradient(x, e.shape.gradients);
  return element_energy(F, nearest_rotation(F, Mat3::Identity()), e.shape.volume, mu, lambda);
}

Corners forces_at(const Element& e, const Corners& x) {
  const Mat3 F = deformation_gradient(x, e.shape.gradients);
  const Mat3 R = nearest_rotation(F, Mat3::Identity());
  return element_forces(F, R, e.shape.gradients, e.shape.volume, mu, lambda);
}

TEST(Tetrahedron, GradientsOfTheUnitCorner) {
  const RestShape s = rest_shape({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1});
  Gradients expected;
  expected << -1, 1, 0, 0, -1, 0, 1, 0, -1, 0, 0, 1;
  EXPECT_DOUBLE_EQ(s.volume, 1.0 / 6.0);
  EXPECT_LT((s.gradients - expected).norm(), 1e-15);
}

TEST(Tetrahedron, DeformationGradientOfAnAffineMap) {
  std::mt19937 random(1);
  for (int i = 0; i < 100; ++i) {
    const Element e = random_element(random);
    const Mat3 F = random_matrix(random, 2.0);
    const Corners x = (F * e.rest).colwise() + random_vector(random, 1.0);
    EXPECT_LT((deformation_gradient(x, e.shape.gradients) - F).norm(), 1e-9);
  }
}

TEST(Tetrahedron, UniaxialStressByHand) {
  // F = diag(1+s, 1, 1): stress λ s + 2 μ s along x, λ s across; the force on a corner is −V σ g.
  const RestShape s = rest_shape({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1});
  const double stretch = 0.01;
  const Mat3 F = Vec3(1 + stretch, 1, 1).asDiagonal();
  const Corners f = element_forces(F, Mat3::Identity(), s.gradients, s.volume, mu, lambda);
  EXPECT_NEAR(f(0, 1), -(lambda + 2 * mu) * stretch / 6, 1e-12);
  EXPECT_NEAR(f(1, 2), -lambda * stretch / 6, 1e-12);
  EXPECT_NEAR(f(2, 3), -lambda * stretch / 6, 1e-12);
  EXPECT_LT(f.rowwise().sum().norm(), 1e-13);
  EXPECT_NEAR(element_energy(F, Mat3::Identity(), s.volume, mu, lambda),
              (mu + lambda / 2) * stretch * stretch / 6, 1e-13);
}

TEST(Tetrahedron, ForceIsTheNegativeGradientOfTheEnergy) {
  std::mt19937 random(2);
  double worst = 0;
  for (int i = 0; i < 300; ++i) {
    const Element e = random_element(random);
    // A third of these are inverted.
    const Mat3 F = random_rotation(random) * (Mat3::Identity() + random_matrix(random, 0.3)) *
                   Vec3(1, 1, i % 3 == 0 ? -0.3 : 1.0).asDiagonal();
    const Corners x = F * e.rest;
    const Corners f = forces_at(e, x);
    for (int k = 0; k < 12; ++k) {
      const double step = 1e-8;
      Corners forward = x;
      Corners backward = x;
      forward(k % 3, k / 3) += step;
      backward(k % 3, k / 3) -= step;
      const double slope = (energy_at(e, forward) - energy_at(e, backward)) / (2 * step);
      worst = std::max(worst, std::abs(slope + f(k % 3, k / 3)) / f.norm());
    }
  }
  EXPECT_LT(worst, 1e-6);
}

TEST(Tetrahedron, StiffnessIsTheSlopeOfTheForceAtAnyRigidPlacement) {
  std::mt19937 random(3);
  for (int i = 0; i < 100; ++i) {
    const Element e = random_element(random);
    const Mat3 R = i == 0 ? Mat3(Mat3::Identity()) : random_rotation(random);
    const Corners x = R * e.rest;
    const Gradients b = R * e.shape.gradients;
    Eigen::Matrix<double, 12, 12> K;
    Eigen::Matrix<double, 12, 12> slope;
    for (int a = 0; a < 4; ++a)
      for (int c = 0; c < 4; ++c)
        K.block<3, 3>(3 * a, 3 * c) = stiffness_block(b.col(a), b.col(c), e.shape.volume, mu, lambda);
    for (int k = 0; k < 12; ++k) {
      const double step = 1e-9;
      Corners forward = x;
      Corners backward = x;
      forward(k % 3, k / 3) += step;
      backward(k % 3, k / 3) -= step;
      const Corners change = forces_at(e, backward) - forces_at(e, forward);
      slope.col(k) = Eigen::Map<const Eigen::Matrix<double, 12, 1>>(change.data()) / (2 * step);
    }
    EXPECT_LT((K - K.transpose()).norm(), 1e-14 * K.norm());
    EXPECT_LT((K - slope).norm(), 1e-6 * K.norm());
  }
}

TEST(Tetrahedron, RotatedGradientsEqualTheRotatedStiffness) {
  std::mt19937 random(4);
  const Element e = random_element(random);
  const Mat3 R = random_rotation(random);
  const Gradients& g = e.shape.gradients;
  for (int a = 0; a < 4; ++a)
    for (int c = 0; c < 4; ++c) {
      const Mat3 k = stiffness_block(g.col(a), g.col(c), e.shape.volume, mu, lambda);
      const Mat3 K = stiffness_block(R * g.col(a), R * g.col(c), e.shape.volume, mu, lambda);
      EXPECT_LT((K - R * k * R.transpose()).norm(), 1e-13 * k.norm());
    }
}

}  // namespace
}  // namespace hapticd
