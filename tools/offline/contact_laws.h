// Two laws that a joint contact solve keeps to rounding, taken from what it leaves.
//
//   reciprocity   max |C_ij − C_jiᵀ| / max |C_ij|,   node i nearest to one instrument, node j to another
//   third law     |Σ f_instruments + Σ f_tissue,obstacles| / (Σ |f_instruments| + Σ |f_tissue,obstacles|)
//
// Forces on instruments are the solution's wrenches, Jᵀ λ; those on tissue Hᵀ λ by node, and F λ on
// obstacles, the rings of incisions among them. 0 where no node is another instrument's, or nothing presses.
// Shares, no units.
#pragma once

#include "physics/contact/contact_solve.h"

namespace hapticd {

double reciprocity_defect(const CondensedProblem& problem, Instruments instruments,
                          const InstrumentPoses& present);

// scratch, solution: of a solve of this problem.
double third_law_defect(const CondensedProblem& problem, const ContactScratch& scratch,
                        const ContactSolution& solution);

}  // namespace hapticd
