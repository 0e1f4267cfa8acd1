// Whether an RTPS message may be given to Cyclone DDS: what its version 0.10 would abort on is found before.
//
// Cyclone ends the process where a discovery message describes a type by an identifier of a kind that it does
// not know (ddsi_typeinfo_valid). So the bounds of submessages and parameter lists must hold, and a
// TypeInformation must be exactly the two hashes, minimal and complete, with their dependencies. Two things
// are refused altogether: discovery in fragments, which could hide a list, and the exchange of whole type
// descriptions, which nobody here needs: those who speak have the type or do not match.
//
// Pure; any thread. Guarantee: never reads outside the message, allocates nothing, time linear in its length.
#pragma once

#include <cstdint>
#include <span>

namespace hapticd {

bool rtps_is_safe(std::span<const std::uint8_t> message) noexcept;

}  // namespace hapticd
