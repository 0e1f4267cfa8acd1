// Which elements may be in a box of the rest shape: a grid of cells over those of the first mesh.
//
// An element that was split off is found with the one of the first mesh it is a part of, which contains it.
// Units: m. Cost of a query: the cells that the box touches and what was ever split off in them.
// Guarantee: no allocation after construction.
#pragma once

#include <array>
#include <vector>

#include "physics/tissue/tissue.h"

namespace hapticd {

class RestGrid {
 public:
  explicit RestGrid(const TissueModel& model);

  // The live elements whose bounding boxes meet this box, ascending, and perhaps no others.
  void find(const TissueModel& model, const TissueState& state, const Eigen::AlignedBox3d& box,
            std::vector<int>& tets) noexcept;

  double mean_edge() const noexcept { return mean_edge_; }  // of the first mesh [m]

 private:
  std::array<int, 3> cell_of(const Vec3& p) const noexcept;
  void follow(const TissueModel& model) noexcept;

  double mean_edge_ = 0;
  Eigen::AlignedBox3d box_;
  Vec3 cell_size_;
  std::array<int, 3> cells_{1, 1, 1};
  std::vector<int> first_;  // per cell, and one more: where its elements begin in roots_
  std::vector<int> roots_;
  std::vector<int> root_, next_;  // per element: of the first mesh; the next of the same root, or −1
  std::vector<int> asked_;        // per root: the query that met it last
  int query_ = 0;
  int followed_ = 0;  // elements that have their root
};

}  // namespace hapticd
