// Whether model and state are a valid mesh: what must be true after every cut and removal. For tests and
// charts.
//
//   each live element is positive at rest and has its own gradients and volume; a face has at most two live
//   elements; `across` is what faces_across finds among the live; the live boundary is closed; mass, counts
//   and stars are sums over the live elements; spare places are orphans and dead
//
// Cost: the whole mesh; it allocates.
#pragma once

#include <string>

#include "physics/cutting/cut_workspace.h"
#include "physics/tissue/surface.h"

namespace hapticd {

// Empty, or the first thing that is wrong. The stars' dead links are forgotten. Of the surface: it must equal
// one made anew of the live elements.
std::string check_mesh(const TissueModel& model, const TissueState& state, CutWorkspace& work,
                       const BoundarySurface* surface = nullptr);

// The least dihedral quality of the live elements at rest.
double least_quality(const TissueModel& model, const TissueState& state);

}  // namespace hapticd
