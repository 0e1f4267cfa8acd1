// The ring that an instrument's shaft passes through, as one row of the contact problem: shaft against ring.
//
//   s: the point of the half axis p + t z, t ≥ 0, nearest to the ring's middle;   d = s − at,   n = d/|d|
//   δ_n = play − |d| + λ_n/k,   0 ≤ δ_n ⟂ λ_n ≥ 0,   ‖λ_t‖ ≤ μ λ_n,   slip: of the shaft's surface at s + R n
//
// So a pressed shaft is pushed back with k (|d| − play) at s, and held along it and, with lever R (its radius
// there), about it by Coulomb's friction, which gives elastically by λ_t/k before it slides. The coupling of
// the massless proxy enters as in every row, J K_eff⁻¹ Jᵀ, the ring as 1/k on the row's own diagonal. A row
// exists while the tip is below the ring's plane. play: the slack; of a shaft that was farther out when it
// came below the plane or was armed there, as far as it has been since at least, never growing: the ring
// closes behind it and gives it no energy. With friction all contacts of the problem have three rows.
// Units: m, N. Guarantee: wait-free, no allocation. Source: DESIGN §13; Coulomb's law as in rows.h.
#pragma once

#include "physics/contact/rows.h"

namespace hapticd {

// Of one instrument's ring: above the ids of pairs.
constexpr std::uint64_t incision_id(int instrument) noexcept {
  return std::uint64_t{0xffff} << 48 | static_cast<std::uint64_t>(instrument);
}

int count_incisions(Instruments instruments, const InstrumentPoses& X_lin) noexcept;

// Behind all other rows, complete but for W and q.
void add_incisions(Instruments instruments, const InstrumentPoses& X_free, const InstrumentPoses& X_lin,
                   const ContactMemory& memory, ContactRows& rows) noexcept;

// Where the ring's material at the contact would be without friction's pull; lambda: in the row's frame. X:
// the instrument at the linearisation.
Vec3 ring_at_rest(const ContactRow& row, const Pose& X, const Vec3& lambda) noexcept;

}  // namespace hapticd
