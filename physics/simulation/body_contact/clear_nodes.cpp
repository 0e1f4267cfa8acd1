#include "physics/simulation/body_contact/clear_nodes.h"

#include <algorithm>
#include <cmath>

namespace hapticd {

double longest_way(std::span<const Vec3> x, std::span<const Vec3> y) {
  double square = 0;
  for (std::size_t n = 0; n < std::min(x.size(), y.size()); ++n)
    square = std::max(square, (y[n] - x[n]).squaredNorm());
  return std::sqrt(square);
}

void ClearNodes::follow(std::span<const Vec3> y) {
  if (y_.size() != y.size()) known_.clear();
  travelled_ += longest_way(y_, y);
  y_.assign(y.begin(), y.end());
}

void ClearNodes::set(int node, const Vec3& x, double distance) {
  if (known_.size() <= static_cast<std::size_t>(node)) known_.resize(static_cast<std::size_t>(node) + 1);
  known_[node] = {x, distance, travelled_};
}

bool ClearNodes::clear(int node, const Vec3& x, double margin, double way) const {
  if (known_.size() <= static_cast<std::size_t>(node)) return false;
  const Known& k = known_[node];
  const double left = k.distance - (travelled_ - k.travelled) - way - margin;
  return left > 0 && (x - k.x).squaredNorm() < left * left;
}

}  // namespace hapticd
