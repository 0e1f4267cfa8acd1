// How deep pieces of tissue are in one another, found without the code that keeps them apart.
//
//   depth = max over surface nodes p that lie in a live tetrahedron of another piece, of dist(p, its surface)
//
// A piece is a connected one of a body (fragments.h); a body that does not move is one. Only bodies that a
// contact pair names are looked at, and a body's own pieces where it is paired with itself. Units: m. Cost:
// linear in nodes and tetrahedra, for a grid sorts them.
#pragma once

#include <span>

#include "physics/simulation/body.h"
#include "physics/simulation/body_contact/contact_candidates.h"

namespace hapticd {

struct PieceOverlap {
  double depth = 0;  // [m], ≥ 0
  int nodes = 0;     // that are inside another piece
};

PieceOverlap find_overlap(const Bodies& bodies, std::span<const ContactPair> pairs);

}  // namespace hapticd
