// What a device says of itself in a slot, and what it may feel. Units: m, N, N·m, device frame.
#pragma once

#include <array>
#include <cstdint>

namespace hapticd {

struct Reading {
  std::array<double, 3> position{};
  std::array<double, 4> orientation{0, 0, 0, 1};  // x, y, z, w
  std::uint32_t buttons = 0;                      // bit 0: phaco, bit 1: aspiration
  bool enable = true;                             // a dead man's switch goes here
};

struct Feel {
  std::array<double, 3> force{};  // on the hand
  std::array<double, 3> torque{};
  std::uint32_t status = 0;  // bits of idl/README.md; 0: all well
};

}  // namespace hapticd
