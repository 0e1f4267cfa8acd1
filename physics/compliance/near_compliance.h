// A compliance of what is simulated of a body whose rest is condensed: any method, on a model of those nodes
// and tetrahedra alone (submodel.h), so that no factor and no solve grows with the mesh.
//
//   b, y, nodes and tetrahedra of the interface are the whole body's; the rest is zero, or covered
//
// Units, shapes and errors as compliance.h; `reshape` throws std::runtime_error: such tissue is not cut. What
// went is told once: a second time is not heard. Allocates in each solve.
#pragma once

#include <functional>
#include <memory>

#include "physics/compliance/reference_compliance.h"
#include "physics/compliance/submodel.h"

namespace hapticd {

// `make` is given the near model, which outlives what it makes.
[[nodiscard]] std::unique_ptr<Compliance> make_near_compliance(
    std::unique_ptr<Submodel> near,
    const std::function<std::unique_ptr<Compliance>(const TissueModel&)>& make);
[[nodiscard]] std::unique_ptr<ReferenceCompliance> make_near_reference_compliance(
    std::unique_ptr<Submodel> near,
    const std::function<std::unique_ptr<ReferenceCompliance>(const TissueModel&)>& make);

}  // namespace hapticd
