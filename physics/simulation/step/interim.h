// The condensed system of a body that lost elements or whose elements turned, from the one it has: no factor.
//
//   before   A (Δx − Δx_p) = r + f           Δx_p: where the body was linearised (predicted_linearisation.h),
//   else 0 after    A' = A − E + s I_o,  r' = r − r_E     E = Σ_e (1/h² + α/h) m_e + (1 + β/h) k_e,  only on
//   nodes G r_e      = m_e (v/h + g − (1/h² + α/h) Δx_p) + f_e(x + Δx_p) − β/h k_e Δx_p
//
//   with M = E − s I_o on G:   C' = C + C_G M (I − C_GG M)⁻¹ C_Gᵀ
//   and with z = C (r − r_E):  Δx_free' = Δx_p + z + C_G M (I − C_GG M)⁻¹ z_G
//
// Woodbury's formula, written so that no element's matrix is inverted: what it is without mass, and what two
// elements share, does not matter. Nodes that lost their last element (o) get the stiffness s of what went,
// for their own row of A − E is zero; they are on no face. The same to rounding as condensing afresh without
// the elements at the same linearisation, of an exact compliance; a stale one's C' is as stale as its C.
// Units: m, N, m/N. Shapes: C is 3·nodes square, Δx_free 3·nodes entries, in the order of the nodes given.
// Errors: by the answer. Source: the paper, eq. (3); departure: M is never inverted. Turned: R goes, R'
// comes.
#pragma once

#include "physics/simulation/step/stale_rotation.h"

namespace hapticd {

// What the factor that the body's compliance holds was linearised at.
enum class Linearised : std::uint8_t {
  here,   // at x, of a linear body
  ahead,  // at x + Body::free.predicted, by linearise_ahead
};

struct Condensed {
  MatX C;
  VecX dx_free;
  VecX dx_pressed;           // where the forces given took the nodes before
  std::vector<int> changed;  // G
  MatX M;                    // … of them [N/m]
  VecX r;                    // … [N]
  VecX moved;                // … y = Δx_free' − Δx_p on G [m]
  MatX moved_by;             // … and ∂y/∂f by a force on the nodes kept [m/N]
};

// On `changed`, what does to the system before what the change does, under a force on the nodes kept:
// M y − r_E [N].
VecX force_of_change(const Condensed& condensed, const VecX& force);

// Of the first `kept` of `nodes`, which name every corner of `tets` and `turned` too; `tets` are gone from
// the state, and the compliance has not been told yet. force: on the nodes, as it was before [N]. False: the
// compliance's zone leaves more than `uncovered` of the nodes out, or what is left has nothing that holds it.
bool woodbury_downdate(Body& body, std::span<const int> tets, std::span<const StaleRotation> stale,
                       Linearised at, double h, std::span<const int> nodes, int kept, const VecX& force,
                       int uncovered, Condensed& out);

}  // namespace hapticd
