// Nodes that cannot have come to a surface since their distance from it was measured.
//
//   d(x, y) ≥ d₀ − ‖x − x₀‖ − Σ_steps max_n ‖y_n − y'_n‖
//
// x: the node; y: the surface's nodes, y' those of the step before. Units: m. Errors: none. Departures: none;
// the bound is exact, so what is left out by it touches nothing.
#pragma once

#include <limits>
#include <span>
#include <vector>

#include "physics/types.h"

namespace hapticd {

class ClearNodes {
 public:
  static constexpr double near = -std::numeric_limits<double>::infinity();  // not clear of any margin

  // The surface is another, or has other nodes.
  void forget() { known_.clear(); }
  // Where the surface's nodes are, once a step.
  void follow(std::span<const Vec3> y);
  // The node is no nearer than that, as followed last.
  void set(int node, const Vec3& x, double distance);
  // Whether it is farther than `margin`. way: no node of the surface is farther from where it was followed.
  bool clear(int node, const Vec3& x, double margin, double way) const;

 private:
  struct Known {
    Vec3 x = Vec3::Zero();
    double distance = near, travelled = 0;
  };
  std::vector<Known> known_;  // by node
  std::vector<Vec3> y_;
  double travelled_ = 0;
};

// Of nodes that went from x to y, the longest way.
double longest_way(std::span<const Vec3> x, std::span<const Vec3> y);

}  // namespace hapticd
