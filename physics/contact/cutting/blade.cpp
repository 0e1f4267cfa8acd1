#include "physics/contact/cutting/blade.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace hapticd {

Blade make_blade(const std::vector<Vec3>& edge, const Vec3& direction, int samples) {
  if (edge.size() < 2) throw std::invalid_argument("an edge has two points or more");
  if (samples < 1 || samples > max_edge_samples)
    throw std::invalid_argument("an edge has 1 to " + std::to_string(max_edge_samples) + " samples");
  if (!(direction.norm() > 0)) throw std::invalid_argument("a direction is not zero");
  Blade blade;
  blade.edge = edge;
  blade.direction = direction.normalized();
  std::vector<double> begin = {0};  // of each piece, and the end
  for (std::size_t i = 1; i < edge.size(); ++i) {
    const double length = (edge[i] - edge[i - 1]).norm();
    if (!(length > 0)) throw std::invalid_argument("two neighbouring points of an edge are one");
    begin.push_back(begin.back() + length);
  }
  const double part = begin.back() / samples;
  double width = 0;
  for (int k = 0; k < samples; ++k) {
    BladePoint point{Vec3::Zero(), 0};
    const double middle = (k + 0.5) * part;
    for (std::size_t i = 1; i < edge.size(); ++i) {
      const Vec3 along = (edge[i] - edge[i - 1]) / (begin[i] - begin[i - 1]);
      const double shared = std::min(begin[i], (k + 1) * part) - std::max(begin[i - 1], k * part);
      if (shared > 0) point.width += shared * along.cross(blade.direction).norm();
      if (middle >= begin[i - 1] && middle <= begin[i])
        point.place = edge[i - 1] + (middle - begin[i - 1]) * along;
    }
    width += point.width;
    blade.sample.push_back(point);
  }
  if (!(width > 1e-6 * begin.back())) throw std::invalid_argument("the direction is along the edge");
  return blade;
}

EdgeSample edge_sample(const Blade& blade, int instrument, int k) noexcept {
  EdgeSample e{};
  e.id = edge_id(instrument, k);
  e.instrument = instrument;
  e.place = blade.sample[static_cast<std::size_t>(k)].place;
  e.direction = blade.direction;
  return e;
}

}  // namespace hapticd
