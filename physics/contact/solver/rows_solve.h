// One set of rows, solved from the forces in the scratch: by the whole solver, or in turns where a solve is
// resumed.
//
// λ is left in scratch.lambda; status, residual, near and laboured in the solution (contact_solve.h). What
// ends unsolved has its normal forces solved once more, which its residual does not know. Units:
// N. Errors: by status. Guarantee: wait-free, no allocation, bounded as the solvers are.
#pragma once

#include "physics/contact/contact_solve.h"

namespace hapticd {

constexpr double doubtful = 0.01;    // of the usable residual: Newton's sum of forces is not to be trusted
constexpr int solves_resumed = 200;  // after one that ended unusable; one less after a doubtful one

// resumed: how many solves are still to come that resume the last one.
void solve_rows(const ContactOptions& options, int resumed, ContactScratch& scratch,
                ContactSolution& out) noexcept;

// λ of one contact in its frame, from the scratch.
Vec3 local_lambda(const ContactScratch& scratch, int i) noexcept;

}  // namespace hapticd
