// Condenses what of a body is far from a place to its boundary (tissue/condensed_tissue.h).
//
//   far: tetrahedra in parts that faces join and that hold on to the world by three nodes or more; the others
//   stay near.   K of the far tissue alone, static and linear, and of what is condensed already;
//   K̂ = K_bb − K_bf K_ff⁻¹ K_fb, where a multifrontal factor with b last is stopped before b
//
// The body may be condensed already: then that is farther still, and the shell between joins it. Units: m.
// Errors: std::invalid_argument where nothing is near; std::runtime_error from the far tissue's factor. Cost:
// that factor, and seven halves of a solve with it. Source: Guyan 1965.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "physics/tissue/tissue.h"

namespace hapticd {

struct NearRegion {
  Vec3 centre = Vec3::Zero();  // [m]
  double radius = 0;           // [m]
  bool follows = false;        // the first instrument; centre: where it begins (near_regions.h)
};

// near: per tetrahedron. Null: nothing is far that was not before. Pre: the state's shape is at rest. What is
// dead in it is neither near nor far.
[[nodiscard]] std::shared_ptr<const CondensedTissue> condense(const TissueModel& model,
                                                              const TissueState& state,
                                                              std::span<const std::uint8_t> near);

// Tetrahedra whose centroid at rest is within the region.
[[nodiscard]] std::vector<std::uint8_t> tets_within(const TissueModel& model, const NearRegion& near);

// Post: the model, of which nothing was condensed, has it (TissueModel::condensed); nodes beyond the boundary
// are fixed, far tetrahedra are dead.
void use_condensed(TissueModel& model, TissueState& state, std::shared_ptr<const CondensedTissue> far);

// All three. Nothing changes where nothing is far. Pre: nothing was removed or cut.
void condense_far(TissueModel& model, TissueState& state, const NearRegion& near);

}  // namespace hapticd
