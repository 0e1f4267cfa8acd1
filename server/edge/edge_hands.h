// Hands as they cross the link, both ways (idl/edge.idl), in the simulation's time.
//
// A message has none, or one an instrument; each is finite, within 1 km, of unit orientation. A hand that was
// received more than `hands_oldest_ns` ago is not there; none comes from the future. Units: SI, ns.
// Guarantee: noexcept, no allocation.
#pragma once

#include <span>

#include "haptic/haptic_step.h"
#include "idl/edge.h"

namespace hapticd {

inline constexpr std::int64_t hands_lost_ns = 60'000'000;     // instruments are then not there
inline constexpr std::int64_t hands_oldest_ns = 500'000'000;  // as old as a problem may be felt (--late)

bool are_hands(std::span<const hapticd_msg_EdgeHand> hands, int instruments) noexcept;

// Pre: are_hands. clock_ns: the reader's clock less the simulation's.
InstrumentInputs read_hands(std::span<const hapticd_msg_EdgeHand> hands, std::int64_t clock_ns,
                            std::int64_t now_ns) noexcept;

// The inverse; of a state older than `hands_lost_ns` is told that nobody is there. here: whether its device
// is answered here. clock_ns: the writer's clock less the simulation's.
hapticd_msg_EdgeHand hand_message(const InstrumentInput& in, bool here, std::int64_t clock_ns,
                                  std::int64_t now_ns) noexcept;

}  // namespace hapticd
