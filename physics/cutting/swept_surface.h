// What a blade's edge sweeps in the rest shape: a triangulated strip between two places of a polyline.
//
//   corners from_i, from_i+1, to_i and from_i+1, to_i+1, to_i;   its positive side is along edge × advance
//
// Units: m, rest frame. Triangles without area are left out. Guarantee: `sweep` allocates nothing within the
// reserved count of edges; the rest is wait-free.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "physics/types.h"

namespace hapticd {

class SweptSurface {
 public:
  explicit SweptSurface(int edges) { triangles_.reserve(2 * static_cast<std::size_t>(edges)); }

  void clear() noexcept { triangles_.clear(); }
  // Adds a strip. Pre: as many points in both.
  void sweep(std::span<const Vec3> from, std::span<const Vec3> to) noexcept;
  bool empty() const noexcept { return triangles_.empty(); }

  // Where the segment from a to b goes through the surface, as a part of it in [0, 1]. A segment that goes
  // through and comes back does not; nor does one that lies in it.
  std::optional<double> crossing(const Vec3& a, const Vec3& b) const noexcept;

  // The distance to the plane of the nearest triangle, positive on the positive side. Pre: not empty.
  double side(const Vec3& p) const noexcept;

  // Unit, of the nearest triangle. Pre: not empty.
  Vec3 normal(const Vec3& p) const noexcept { return nearest(p).normal; }

  // Pre: not empty.
  Eigen::AlignedBox3d box() const noexcept;

 private:
  struct Facet {
    Vec3 a, b, c;
    Vec3 normal;  // unit
  };
  void add(const Vec3& a, const Vec3& b, const Vec3& c) noexcept;
  const Facet& nearest(const Vec3& p) const noexcept;

  std::vector<Facet> triangles_;
};

}  // namespace hapticd
