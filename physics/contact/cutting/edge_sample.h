// A sample of a blade's edge against the front of its cut, under the law of cutting.
//
//   0 ≤ λ_e ≤ J w_e + c w_e a_e/T,   a_e ≥ 0,   (J w_e + c w_e a_e/T − λ_e) a_e = 0,   λ_e ⟂ δ_e + a_e ≥ 0
//   δ_e = d·(x_front − x_edge) + (advance − published advance),   x_front = Σ_a weight[a] · patch node[a]
//
// λ_e pushes the tissue along d and the blade along −d. Below the limit J w_e the edge is a frictionless
// contact with normal d; at the limit the front advances by a_e along d. The advance is plastic: each loop
// remembers its total, the front published is where `advance` of it was realised, and what is remembered
// beyond that is added to the gap. J: toughness of the tissue [J/m²]; w_e: the edge's width across d [m]; c:
// its viscosity against cutting [N·s/m²], by a_e in the solve's period T; 0: dry, rate-independent.
// Units: m, N. Source: DESIGN §11; Griffith 1921 (J a = work of separation).
#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "physics/types.h"

namespace hapticd {

// Of the normal force of a contact that is no edge [N].
inline constexpr double no_limit = std::numeric_limits<double>::infinity();

inline constexpr int max_edge_samples = 32;  // of one problem

struct EdgeSample {
  std::uint64_t id;                  // edge_id: stable between steps
  std::int32_t instrument;           // whose blade
  std::int32_t body;                 // that the front is in
  std::array<std::int32_t, 4> node;  // of the patch; a front on a face names one twice, with weight 0
  std::array<double, 4> weight;      // barycentric, sums to 1
  Vec3 place;                        // on the edge, instrument's frame [m]
  Vec3 direction;                    // d, unit, instrument's frame: from the blade into the tissue
  double limit;                      // J w_e [N]
  double advance;                    // of this front since its cut began [m]
  double viscosity = 0;              // c w_e [N·s/m]
};

// Of one sample of one instrument's edge: above the ids of tissue samples, below those of pairs.
constexpr std::uint64_t edge_id(int instrument, int sample) noexcept {
  return std::uint64_t{0xfe} << 56 | static_cast<std::uint64_t>(instrument) << 32 |
         static_cast<std::uint64_t>(sample);
}
constexpr bool is_edge(std::uint64_t id) noexcept { return id >> 56 == 0xfe; }

}  // namespace hapticd
