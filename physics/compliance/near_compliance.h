// A compliance of what is simulated of a body whose rest is condensed: any method, on a model of those nodes
// and tetrahedra alone, so that no factor and no solve grows with the mesh.
//
//   near model: live tetrahedra and their nodes, numbered anew; CondensedTissue on its boundary
//   b, y, nodes and tetrahedra of the interface are the whole body's; the rest is zero, or covered
//
// Units, shapes and errors as compliance.h; `reshape` throws std::runtime_error: such tissue is not cut.
// Allocates in each solve.
#pragma once

#include <functional>

#include "physics/compliance/reference_compliance.h"

namespace hapticd {

// `make` is given the near model, which outlives what it makes. Pre: model.condensed; the model outlives all.
[[nodiscard]] std::unique_ptr<Compliance> make_near_compliance(
    const TissueModel& model, const std::function<std::unique_ptr<Compliance>(const TissueModel&)>& make);
[[nodiscard]] std::unique_ptr<ReferenceCompliance> make_near_reference_compliance(
    const TissueModel& model,
    const std::function<std::unique_ptr<ReferenceCompliance>(const TissueModel&)>& make);

}  // namespace hapticd
