// The arithmetic of a solve with panels that are rounded to 16 bits, for the processor's widest vectors.
//
// A panel is `height` rows of `width` columns, its own rows first. It lies as groups of eight columns (the
// last may have fewer), one after another, as they are read; `x` is what the panel's rows hold:
//
//   group     its triangle's inverse T⁻¹ in single precision, a unit u_j per column, and the rows below as
//             tiles of 16 rows by its columns of 16-bit numbers q:  L_ij ≈ u_j q_ij
//   forward   x_g ← T⁻¹ x_g,  then  x_i ← x_i − Σ_j L_ij x_j of the rows below
//   backward  x_g ← x_g − Σ_i L_ij x_i,  then  x_g ← T⁻ᵀ x_g,  the last group first
//
// A solve is bound by memory: so it is one stream of bytes, ascending or descending, fetched ahead.
// Shapes: x has height + tile_rows numbers; the ones behind the panel's rows are finite, and ignored.
// Guarantee: wait-free, no allocation. Units: L Lᵀ [N/m].
#pragma once

#include <cstddef>
#include <cstdint>

namespace hapticd {

inline constexpr int group_columns = 8;
inline constexpr int tile_rows = 16;

// Tiles follow it.
struct alignas(32) QuantisedGroup {
  float inverse[group_columns][group_columns];  // T⁻¹ by column; rows and columns beyond the group's are zero
  float unit[group_columns];
};

constexpr int tiles_of(int rows) noexcept { return (rows + tile_rows - 1) / tile_rows; }

// Of a group with so many columns and rows below it.
constexpr std::size_t group_bytes(int columns, int rows) noexcept {
  return sizeof(QuantisedGroup) + sizeof(std::int16_t) * tile_rows * columns * tiles_of(rows);
}

struct QuantisedKernels {
  const char* name;
  // Returns where the panel ends.
  const std::byte* (*forward)(const std::byte* panel, int width, int height, float* x) noexcept;
  // From where it ends; returns where it begins.
  const std::byte* (*backward)(const std::byte* end, int width, int height, float* x) noexcept;
};

extern const QuantisedKernels generic_quantised_kernels;
extern const QuantisedKernels avx2_quantised_kernels;    // only where the processor has AVX2 and FMA
extern const QuantisedKernels avx512_quantised_kernels;  // … AVX-512F, VL, BW

// The best that this processor runs.
const QuantisedKernels& quantised_kernels() noexcept;

}  // namespace hapticd
