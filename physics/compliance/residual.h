// How far a compliance is from the inverse of the present system matrix, from one sampled solve.
//
//   y = C b,   r = b − A y,   residual = ‖r‖/‖b‖,   error = ‖C r‖/‖y‖
//
// b has entries of one size and every wavelength, so that each mode of the error has its share. The
// residual alone is blind where A is soft (a nearly free piece: y wrong by 22 times, residual 1e-4); C r is
// what one step of iterative refinement would add, the error itself to first order. The two are taken
// together, and a result that is not finite counts as infinite.
// Units: none. Cost: two solves and one product with A. Allocates.
#pragma once

#include "physics/compliance/compliance.h"
#include "physics/compliance/system_matrix.h"

namespace hapticd {

struct SampledError {
  double residual = 0;
  double error = 0;
};

// The first half of a sample: r = b − A y.
struct ResidualSample {
  VecX r;               // empty: nothing is in the system
  double residual = 0;  // ‖r‖/‖b‖
  double answer = 0;    // ‖y‖
};
ResidualSample sample_residual(Compliance& compliance, const SystemMatrix& A);
// … against the A of a state, which is not assembled for it.
ResidualSample sample_residual(Compliance& compliance, const TissueModel& model, const TissueState& state,
                               double h);

// The second half; after a further update it is C of then, which to first order is the same.
SampledError error_of(Compliance& compliance, ResidualSample sample);

// Both. `A` assembled at the state of the compliance's last update.
SampledError sample_error(Compliance& compliance, const SystemMatrix& A);

ComplianceHealth health_of(const SampledError& sampled, const ComplianceOptions& options) noexcept;

}  // namespace hapticd
