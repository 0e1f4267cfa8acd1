// How much tissue is distorted, for a colour: the equivalent strain at its nodes.
//
//   F = Σ_a x_a g_aᵀ,  E = ½(FᵀF − I),  ε = √(⅔ dev E : dev E);  at a node the mean of its living tetrahedra
//
// In a body of one material it is the equivalent stress, von Mises's, over three shear moduli: the same
// picture. No unit; 0 at rest and in any rigid motion. A node without living tetrahedra has 0.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "physics/tissue/mesh.h"
#include "physics/tissue/tissue.h"

namespace hapticd {

class StrainAtNodes {
 public:
  // nodes: at rest. Tetrahedra without volume count as undistorted.
  StrainAtNodes(std::span<const Vec3> nodes, std::span<const Tet> tets);

  // alive: one per tetrahedron; x: 3 per node.
  std::vector<float> of(std::span<const float> x, std::span<const std::uint8_t> alive) const;

 private:
  std::vector<Tet> tets_;
  std::vector<Gradients> gradients_;
  std::size_t nodes_;
};

}  // namespace hapticd
