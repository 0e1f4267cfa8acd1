#include "tools/view/strain.h"

#include <cmath>

#include "physics/tissue/strain.h"
#include "physics/tissue/tetrahedron.h"

namespace hapticd {

StrainAtNodes::StrainAtNodes(std::span<const Vec3> nodes, std::span<const Tet> tets)
    : tets_(tets.begin(), tets.end()), nodes_(nodes.size()) {
  gradients_.reserve(tets.size());
  for (const Tet& t : tets_) {
    const auto at = [&](std::size_t a) -> const Vec3& { return nodes[static_cast<std::size_t>(t[a])]; };
    const bool flat = !(std::abs(signed_volume(at(0), at(1), at(2), at(3))) > 0);
    gradients_.push_back(flat ? Gradients::Zero() : rest_shape(at(0), at(1), at(2), at(3)).gradients);
  }
}

std::vector<float> StrainAtNodes::of(std::span<const float> x, std::span<const std::uint8_t> alive) const {
  std::vector<float> strain(nodes_, 0), count(nodes_, 0);
  for (std::size_t e = 0; e < tets_.size(); ++e) {
    if (!alive[e] || gradients_[e].isZero()) continue;
    Corners corners;
    for (std::size_t a = 0; a < 4; ++a)
      corners.col(static_cast<int>(a)) =
          Eigen::Map<const Eigen::Vector3f>(&x[3 * static_cast<std::size_t>(tets_[e][a])]).cast<double>();
    const auto value = static_cast<float>(equivalent_strain(deformation_gradient(corners, gradients_[e])));
    for (const int n : tets_[e]) {
      strain[static_cast<std::size_t>(n)] += value;
      count[static_cast<std::size_t>(n)] += 1;
    }
  }
  for (std::size_t n = 0; n < nodes_; ++n)
    if (count[n] > 0) strain[n] /= count[n];
  return strain;
}

}  // namespace hapticd
