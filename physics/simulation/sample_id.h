// Names of patch samples: stable between steps while their face is there.
//
//   body (8 bits) · face (44) · point in the face (12)
#pragma once

#include <cstdint>

namespace hapticd {

constexpr std::uint64_t sample_id(int body, int face, int point) noexcept {
  return static_cast<std::uint64_t>(body) << 56 | static_cast<std::uint64_t>(face) << 12 |
         static_cast<std::uint64_t>(point);
}

constexpr int body_of_sample(std::uint64_t id) noexcept { return static_cast<int>(id >> 56); }

}  // namespace hapticd
