#include "physics/contact/placed_instrument.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hapticd {
namespace {

constexpr double round_off = 1e-12;

double square(double x) noexcept { return x * x; }

}  // namespace

PlacedInstrument::PlacedInstrument(const Instrument& instrument, const Pose& X) noexcept
    : instrument_(instrument),
      X_(X),
      count_(instrument.primitives.size() <= capacity ? instrument.primitives.size() : 0) {
  for (std::size_t k = 0; k < count_; ++k) {
    const Primitive& p = instrument.primitives[k];
    placed_[k] = {(X.q * p.placement.q).conjugate().toRotationMatrix(), X.to_world(p.placement.p), p.shape,
                  p.radius, p.half_length};
  }
}

bool PlacedInstrument::within(std::size_t k, const Vec3& x, double reach) const noexcept {
  const Placed& p = placed_[k];
  const Vec3 at = p.world_to_local * (x - p.p);
  const double grown = p.radius + reach;
  switch (p.shape) {
    case Shape::sphere:
      return grown > 0 && at.squaredNorm() < square(grown);
    case Shape::capsule: {
      const double beyond = std::max(0.0, std::abs(at.z()) - p.half_length);
      return grown > 0 && at.head<2>().squaredNorm() + square(beyond) < square(grown);
    }
    case Shape::cylinder:
      return grown > 0 && std::abs(at.z()) < p.half_length + reach &&
             at.head<2>().squaredNorm() < square(grown);
    case Shape::convex:
      break;
  }
  const auto& planes = instrument_.primitives[k].planes;
  return std::all_of(planes.begin(), planes.end(), [&](const Eigen::Vector4d& plane) {
    return plane.head<3>().dot(at) + plane[3] < reach;
  });
}

bool PlacedInstrument::near(std::size_t k, const Vec3& x, double reach) const noexcept {
  return count_ == 0 || within(k, x, reach + round_off);
}

bool PlacedInstrument::near(const Vec3& x, double reach) const noexcept {
  for (std::size_t k = 0; k < count_; ++k)
    if (within(k, x, reach + round_off)) return true;
  return count_ < instrument_.primitives.size();
}

Gap PlacedInstrument::gap(std::size_t k, const Vec3& x) const noexcept {
  const Primitive& p = instrument_.primitives[k];
  Gap gap;
  if (count_ == 0) {
    gap = gap_at(p, p.placement.to_local(X_.to_local(x)));
    gap.normal = X_.q * (p.placement.q * gap.normal);
  } else {
    gap = gap_at(p, placed_[k].world_to_local * (x - placed_[k].p));
    gap.normal = placed_[k].world_to_local.transpose() * gap.normal;
  }
  gap.primitive = static_cast<int>(k);
  return gap;
}

Gap PlacedInstrument::gap(const Vec3& x) const noexcept {
  if (count_ < instrument_.primitives.size()) return gap_at(instrument_, X_, x);
  Gap nearest{std::numeric_limits<double>::infinity(), Vec3::UnitZ(), -1};
  for (std::size_t k = 0; k < count_; ++k) {
    const Gap gap = gap_at(instrument_.primitives[k], placed_[k].world_to_local * (x - placed_[k].p));
    if (gap.distance < nearest.distance) nearest = {gap.distance, gap.normal, static_cast<int>(k)};
  }
  if (nearest.primitive >= 0)
    nearest.normal =
        placed_[static_cast<std::size_t>(nearest.primitive)].world_to_local.transpose() * nearest.normal;
  return nearest;
}

}  // namespace hapticd
