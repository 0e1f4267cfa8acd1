// Whether a point is inside a closed surface.
//
//   w(p) = 1/4π Σ_faces Ω(face, p),   tan(Ω/2) = a·(b × c) / (abc + a·b c + b·c a + c·a b)
//
// w is 1 inside and 0 outside, anything between where the surface has a hole; inside is w > ½. a, b, c: the
// face's corners seen from p. Units: m. Cost: one arc tangent a face, 0.1 ms at 2 000.
// Source: van Oosterom and Strackee 1983; Jacobson, Kavan and Sorkine-Hornung 2013 for surfaces not closed.
#pragma once

#include <span>

#include "physics/tissue/surface.h"

namespace hapticd {

bool is_inside(std::span<const SurfaceFace> faces, std::span<const Vec3> x, const Vec3& point) noexcept;

}  // namespace hapticd
