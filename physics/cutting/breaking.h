// Which faces break: where the tension across a face at the surface would drive a crack of the face's size.
//
//   c σₙ² l/E' > toughness,   σₙ = n · σ n,   E' = E/(1 − ν²),   l = √area
//
// Looked at are the inner faces with an edge on the surface, so that a crack begins there and goes on from
// what opened; σₙ is the mean of the face's two tetrahedra, in their turned frames. Ahead of a sharp crack
// σₙ² falls as 1/l, so on fine meshes the load at which it runs is the toughness's; c is such that a beam of
// two arms has the theory's with eight elements over an arm, and coarser ones are too strong. Only tension
// opens faces. A crack that may choose its faces wanders and leaves crumbs, though a tetrahedron keeps one
// face joined: where tissue parts along known planes, name their faces (`clefts`). Units: Pa, m, J/m². Pre:
// the state's rotations are those at x. Errors: none. Cost: a pass over the tetrahedra. Source: Griffith,
// Phil. Trans. A 221 (1921) 163; departure: the face is the flaw.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "physics/cutting/tearing.h"

namespace hapticd {

// [J/m²] of an inner face, by its id; zero under compression.
double release_of_face(const TissueModel& model, const TissueState& state, int face);

// Ids of the faces that open now, `settings.most` at most, those that would release most first. held_open: of
// the model's CutWorkspace.
std::vector<int> faces_that_break(const TissueModel& model, const TissueState& state,
                                  const BoundarySurface& surface, std::span<const std::uint8_t> held_open,
                                  const TearSettings& settings);

}  // namespace hapticd
