// Seeded random rotations, matrices and tetrahedra for the tissue tests.
#pragma once

#include <random>

#include "physics/types.h"

namespace hapticd {

inline Vec3 random_vector(std::mt19937& random, double size) {
  std::uniform_real_distribution<double> uniform(-size, size);
  const double x = uniform(random);
  const double y = uniform(random);
  return {x, y, uniform(random)};
}

inline Mat3 random_rotation(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const double w = normal(random);
  const double x = normal(random);
  const double y = normal(random);
  return Quat(w, x, y, normal(random)).normalized().toRotationMatrix();
}

inline Mat3 random_matrix(std::mt19937& random, double size) {
  Mat3 M;
  for (int c = 0; c < 3; ++c) M.col(c) = random_vector(random, size);
  return M;
}

}  // namespace hapticd
