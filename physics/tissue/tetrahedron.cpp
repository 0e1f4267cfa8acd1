#include "physics/tissue/tetrahedron.h"

#include <Eigen/LU>

namespace hapticd {

RestShape rest_shape(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& d) noexcept {
  Mat3 edges;
  edges << b - a, c - a, d - a;
  RestShape shape;
  shape.volume = signed_volume(a, b, c, d);
  // Rows of edges⁻¹ are ∇N of corners b, c, d; the four gradients sum to zero.
  shape.gradients.rightCols<3>() = edges.inverse().transpose();
  shape.gradients.col(0) = -shape.gradients.rightCols<3>().rowwise().sum();
  return shape;
}

}  // namespace hapticd
