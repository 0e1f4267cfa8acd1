// Whether a loose piece of tissue passes an aspiration port's lumen.
//
//   ρ(P) = min over directions d of the radius of the smallest circle around P's nodes projected along d,
//   P passes  ⇔  ρ(P) ≤ lumen
//
// The direction is free because the pull turns a loose piece end on. This is exact for a rigid piece in a
// straight round bore; soft tissue is taken to be as wide as it is now, so a piece that would be squeezed
// through is held. Volume alone would let a slice pass that is wider than the bore.
// Units: m. Accuracy: the direction is searched on a grid and refined, ρ is found to 1 % (tests), never too
// small. Cost: about 0.2 ms for 100 nodes; microseconds where inertia or the enclosing sphere decide.
// Source: Welzl 1991 (smallest enclosing circle); Weißbach 1983 (regular tetrahedron, ρ = edge/2).
#pragma once

#include <span>
#include <vector>

#include "physics/contact/instrument.h"
#include "physics/tissue/tissue.h"

namespace hapticd {

// ρ; stops as soon as it is known to be at most `enough`, and then returns what it has. No nodes: 0.
double passing_radius(std::span<const Vec3> nodes, double enough = 0);

// Of a point in the instrument's frame, to the disc that is the port's opening.
double distance_to_opening(const Port& port, const Vec3& local) noexcept;

// Present positions of the tetrahedra's nodes, each once.
std::vector<Vec3> nodes_of(const TissueModel& model, const TissueState& state, std::span<const int> tets);

}  // namespace hapticd
