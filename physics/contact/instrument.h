// The instrument: a rigid set of convex primitives, known by its signed distance to a point.
//
//   gap(x) = min over primitives of sd_k(x),   normal = ∇gap(x)   (from the instrument to the tissue)
//
// Units: m. The instrument's frame has its origin at the tip and +z along the shaft, away from it.
// Guarantee: `gap_at` is wait-free, allocates nothing, is bounded by the number of primitives.
// Exact for spheres, capsules and cylinders; for a convex mesh exact inside and outside faces,
// a lower bound next to edges and vertices (largest plane distance).
#pragma once

#include <string>
#include <vector>

#include "physics/contact/cutting/blade.h"
#include "physics/types.h"

namespace hapticd {

enum class Shape { sphere, capsule, cylinder, convex };

struct Primitive {
  std::string name;
  Shape shape = Shape::sphere;
  double radius = 0;                    // sphere, capsule, cylinder [m]
  double half_length = 0;               // capsule (of its segment), cylinder; along local z [m]
  Pose placement;                       // primitive frame in the instrument's frame
  std::vector<Vec3> vertices;           // convex: hull vertices, primitive frame [m]
  std::vector<Eigen::Vector4d> planes;  // convex: n·x + d ≤ 0 inside, |n| = 1
};

// An opening that an aspiration pump draws through (suction.h). A radius of zero: none.
struct Port {
  Vec3 position = Vec3::Zero();      // of its middle, instrument's frame [m]
  Vec3 direction = -Vec3::UnitZ();   // unit, out of it
  double radius = 0, reach = 0;      // [m]
  double vacuum = 0, rise_time = 0;  // the pump's largest [Pa], its time constant [s]
  double flow = 0;   // … what it moves through the open port [m³/s]; 0: no flow is modelled
  double lumen = 0;  // inner radius of the bore behind it [m]; 0: not known
};

// A compliant ring that the instrument's axis passes through (incision_rows.h). A stiffness of zero: none.
struct Incision {
  Vec3 at = Vec3::Zero();     // its middle, scene [m]
  Vec3 axis = Vec3::UnitZ();  // unit, out of the body
  double slack = 0;           // radial play of the instrument's axis [m]
  double stiffness = 0;       // beyond it [N/m]
  double friction = 0;        // Coulomb μ, along the shaft and about it
};

struct Instrument {
  std::vector<Primitive> primitives;
  int tip = 0;  // the primitive that destroys tissue, index into `primitives`
  Blade blade;
  Port port;
  Incision incision;
};

struct Gap {
  double distance;  // [m], negative inside the instrument
  Vec3 normal;      // unit, world axes, from the instrument to the point
  int primitive;    // index of the nearest primitive
};

// Signed distance of one primitive at a point given in the primitive's frame; normal in that frame.
Gap gap_at(const Primitive& primitive, const Vec3& local) noexcept;

// Signed distance of the whole instrument placed at X, at the world point x.
Gap gap_at(const Instrument& instrument, const Pose& X, const Vec3& x) noexcept;

// Farthest point of a primitive in world direction d (support function), for GJK.
Vec3 support(const Primitive& primitive, const Pose& X, const Vec3& d) noexcept;

// Makes a convex primitive from points: hull vertices and face planes. Throws std::invalid_argument
// when the points span no volume.
Primitive make_convex(std::string name, const std::vector<Vec3>& points, const Pose& placement);

}  // namespace hapticd
