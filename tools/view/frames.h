// What crosses to the page in binary: little-endian, floats first, so that a browser can look at them in
// place.
//
//   0   uint32  kind            1 rest, 2 surface, 3 motion, 4 contacts
//   4   uint32  body
//   8   uint32  count
//   12  uint32  extra           surface: tetrahedra removed; contacts: instruments
//   16  float64 time            s, of the daemon's or the recording's own
//   24  by kind, count times:
//       rest      float32 [3]   node at rest, m
//       surface   uint32 [3]    corners, wound outward;  then count × uint8: bit 0 exposed by a removal, bit
//       1 of a
//                               piece that came loose
//       motion    float32 [3]   node now, m;             then count × float32: equivalent strain (strain.h)
//       contacts  float32 [7]   place [m], force on the tissue [N], gap [m]; before them each instrument's
//                               position and quaternion, float32 [7]; then count × uint8 [2]: the instrument
//                               that presses, and the one that is pressed (255: tissue)
//
// Pure functions. The page's side is page/protocol.js.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "physics/tissue/surface.h"

namespace hapticd {

inline constexpr std::uint8_t view_cut = 1, view_loose = 2;

std::string rest_frame(std::uint32_t body, std::span<const float> nodes);
// loose: per tetrahedron; a face belongs to tetrahedron id/4.
std::string surface_frame(std::uint32_t body, std::uint32_t removed, std::span<const SurfaceFace> faces,
                          std::span<const std::uint8_t> loose);
std::string motion_frame(std::uint32_t body, double time, std::span<const float> nodes,
                         std::span<const float> strain);
// instruments, contacts: 7 each; pressing: 2 per contact.
std::string contacts_frame(double time, std::span<const float> instruments, std::span<const float> contacts,
                           std::span<const std::uint8_t> pressing);

}  // namespace hapticd
