// The kernels of quantised_kernels.h for one instruction set: `Isa` names its vector of floats, and fills one
// from 16-bit integers.
//
// Included by one source file for each instruction set, compiled with that set's flags; as in front_tiles.h
// nothing here has external linkage.
#pragma once

#include "physics/compliance/zone/quantised_kernels.h"

namespace hapticd {
namespace {

using Octet = float __attribute__((vector_size(32)));

// Lane k of the sum: of all of v[k].
inline void sum_each(const Octet (&v)[group_columns], Octet& sum) noexcept {
  Octet two[4], four[2];
  for (int k = 0; k < 4; ++k)
    two[k] = __builtin_shufflevector(v[2 * k], v[2 * k + 1], 0, 8, 2, 10, 4, 12, 6, 14) +
             __builtin_shufflevector(v[2 * k], v[2 * k + 1], 1, 9, 3, 11, 5, 13, 7, 15);
  for (int k = 0; k < 2; ++k)
    four[k] = __builtin_shufflevector(two[2 * k], two[2 * k + 1], 0, 1, 8, 9, 4, 5, 12, 13) +
              __builtin_shufflevector(two[2 * k], two[2 * k + 1], 2, 3, 10, 11, 6, 7, 14, 15);
  sum = __builtin_shufflevector(four[0], four[1], 0, 1, 2, 3, 8, 9, 10, 11) +
        __builtin_shufflevector(four[0], four[1], 4, 5, 6, 7, 12, 13, 14, 15);
}

template <class Isa>
struct QuantisedTiles {
  using Vector = typename Isa::Vector;
  static constexpr int lanes = static_cast<int>(sizeof(Vector) / sizeof(float));
  static constexpr int vectors = tile_rows / lanes;
  static constexpr int ahead = 2048;  // bytes: what memory delivers in its own latency
  static constexpr int line = 64;

  static void load(const float* p, Vector& v) noexcept { __builtin_memcpy(&v, p, sizeof v); }
  // Eight lanes of the same sum.
  static void fold(const Vector& v, Octet& folded) noexcept {
    float lane[lanes];
    __builtin_memcpy(lane, &v, sizeof v);
    folded = Octet{};
    __builtin_memcpy(&folded, lane, lanes < group_columns ? sizeof v : sizeof folded);
    if constexpr (lanes > group_columns) {
      Octet other;
      __builtin_memcpy(&other, lane + group_columns, sizeof other);
      folded += other;
    }
  }

  template <int columns>
  static void fetch(const std::int16_t* tile, int away) noexcept {
    const auto* there = reinterpret_cast<const char*>(tile) + away;
    for (int l = 0; l < columns * tile_rows * 2; l += line) __builtin_prefetch(there + l, 0, 3);
  }

  template <int columns>
  static const std::byte* forward_group(const std::byte* at, int rows, float* x) noexcept {
    const auto* group = reinterpret_cast<const QuantisedGroup*>(at);
    Octet y = {}, unit;
    for (int c = 0; c < columns; ++c) {
      Octet column;
      __builtin_memcpy(&column, group->inverse[c], sizeof column);
      y += column * x[c];
    }
    __builtin_memcpy(x, &y, columns * sizeof(float));
    __builtin_memcpy(&unit, group->unit, sizeof unit);
    const Octet minus = -y * unit;
    const auto* tile = reinterpret_cast<const std::int16_t*>(group + 1);
    float* below = x + columns;
    for (int t = tiles_of(rows); t > 0; --t, tile += columns * tile_rows, below += tile_rows) {
      fetch<columns>(tile, ahead);
#pragma GCC unroll 2
      for (int v = 0; v < vectors; ++v) {
        Vector sum, q;
        load(below + v * lanes, sum);
#pragma GCC unroll 8
        for (int c = 0; c < columns; ++c) {
          Isa::widen(tile + c * tile_rows + v * lanes, q);
          sum += q * minus[c];
        }
        __builtin_memcpy(below + v * lanes, &sum, sizeof sum);
      }
    }
    return reinterpret_cast<const std::byte*>(tile);
  }

  template <int columns>
  static const std::byte* backward_group(const std::byte* end, int rows, float* x) noexcept {
    Vector sum[columns] = {};
    const auto* tile = reinterpret_cast<const std::int16_t*>(end);
    for (int t = tiles_of(rows) - 1; t >= 0; --t) {
      tile -= columns * tile_rows;
      fetch<columns>(tile, -ahead);
#pragma GCC unroll 2
      for (int v = 0; v < vectors; ++v) {
        Vector below, q;
        load(x + columns + t * tile_rows + v * lanes, below);
#pragma GCC unroll 8
        for (int c = 0; c < columns; ++c) {
          Isa::widen(tile + c * tile_rows + v * lanes, q);
          sum[c] += q * below;
        }
      }
    }
    const auto* group = reinterpret_cast<const QuantisedGroup*>(tile) - 1;
    Octet part[group_columns] = {}, y = {}, unit, dot;
    for (int c = 0; c < columns; ++c) fold(sum[c], part[c]);
    sum_each(part, dot);
    __builtin_memcpy(&unit, group->unit, sizeof unit);
    __builtin_memcpy(&y, x, columns * sizeof(float));
    y -= unit * dot;
    for (int c = 0; c < group_columns; ++c) {
      __builtin_memcpy(&part[c], group->inverse[c], sizeof part[c]);
      part[c] *= y;
    }
    sum_each(part, y);
    __builtin_memcpy(x, &y, columns * sizeof(float));
    return reinterpret_cast<const std::byte*>(group);
  }

  // A group that has fewer columns than eight.
  static constexpr auto last_forward = [](int columns) noexcept {
    constexpr decltype(&forward_group<1>) of[] = {forward_group<1>, forward_group<2>, forward_group<3>,
                                                  forward_group<4>, forward_group<5>, forward_group<6>,
                                                  forward_group<7>};
    return of[columns - 1];
  };
  static constexpr auto last_backward = [](int columns) noexcept {
    constexpr decltype(&backward_group<1>) of[] = {backward_group<1>, backward_group<2>, backward_group<3>,
                                                   backward_group<4>, backward_group<5>, backward_group<6>,
                                                   backward_group<7>};
    return of[columns - 1];
  };

  static const std::byte* forward(const std::byte* at, int width, int height, float* x) noexcept {
    int j = 0;
    for (; j + group_columns <= width; j += group_columns)
      at = forward_group<group_columns>(at, height - j - group_columns, x + j);
    return j == width ? at : last_forward(width - j)(at, height - width, x + j);
  }

  static const std::byte* backward(const std::byte* end, int width, int height, float* x) noexcept {
    int j = width / group_columns * group_columns;
    if (j < width) end = last_backward(width - j)(end, height - width, x + j);
    while ((j -= group_columns) >= 0)
      end = backward_group<group_columns>(end, height - j - group_columns, x + j);
    return end;
  }
};

}  // namespace
}  // namespace hapticd
