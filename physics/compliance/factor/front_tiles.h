// The kernels of front_kernels.h for one instruction set: `Isa` names its vector type and number of lanes,
// and adds the numbers from `from` on to those of eight at `to` that have a bit in a mask, made ready for it
// by `spread`.
//
// Included by one source file for each, compiled with that set's flags: everything here has internal linkage
// and nothing of the standard library is called, so that no function compiled for a newer processor can be
// picked by the linker for an older one.
#pragma once

#include "physics/compliance/factor/front_kernels.h"

namespace hapticd {
namespace {

enum class Finish { none, solve, factor };

template <class Isa>
struct FrontTiles {
  using Vector = typename Isa::Vector;
  static constexpr int lanes = Isa::lanes;
  static constexpr int most_vectors = 3;
  static_assert(most_tile_rows % (most_vectors * lanes) == 0 && row_multiple % lanes == 0);

  static Vector load(const double* p) noexcept {
    Vector v;
    __builtin_memcpy(&v, p, sizeof v);
    return v;
  }
  static void store(const Vector& v, double* p) noexcept { __builtin_memcpy(p, &v, sizeof v); }

  struct Tile {
    const double* A;  // its rows, before column `depth`
    const double* B;  // rows that are its columns
    std::ptrdiff_t stride, B_stride;
    int depth;
    double* C;
    std::ptrdiff_t C_stride;
    const double* triangle;  // of the tile's columns: L_JJ, and above its diagonal L_JJ⁻ᵀ, to solve with
    std::ptrdiff_t triangle_stride;
    double* reciprocal;  // of the diagonal of both
    FrontAhead* ahead;
  };

  // Lanes that are above the diagonal in column j of a triangle.
  static auto above(int j) noexcept {
    Vector lane;
    for (int l = 0; l < lanes; ++l) lane[l] = l;
    return lane < static_cast<double>(j);
  }

  // C ← −A Bᵀ; or C ← (C − A Bᵀ) L_JJ⁻ᵀ; or C ← the Cholesky factor of C − A Bᵀ, L_JJ⁻ᵀ above its diagonal.
  // False: a pivot is not positive.
  template <int vectors, int columns, Finish finish>
  static bool run(const Tile& tile) noexcept {
    tile.ahead->fetch();
    Vector c[columns][vectors];
#pragma GCC unroll 8
    for (int j = 0; j < columns; ++j)
#pragma GCC unroll 3
      for (int v = 0; v < vectors; ++v)
        c[j][v] = finish == Finish::none ? Vector{} : load(tile.C + j * tile.C_stride + v * lanes);
    const double* a = tile.A;
    const double* b = tile.B;
    for (int k = 0; k < tile.depth; ++k, a += tile.stride, b += tile.B_stride) {
      Vector row[vectors];
#pragma GCC unroll 3
      for (int v = 0; v < vectors; ++v) row[v] = load(a + v * lanes);
#pragma GCC unroll 8
      for (int j = 0; j < columns; ++j)
#pragma GCC unroll 3
        for (int v = 0; v < vectors; ++v) c[j][v] -= row[v] * b[j];
    }
    if constexpr (finish == Finish::solve) {
#pragma GCC unroll 8
      for (int j = columns - 1; j >= 0; --j) {
        const double* T = tile.triangle + j * tile.triangle_stride;
#pragma GCC unroll 3
        for (int v = 0; v < vectors; ++v) c[j][v] *= tile.reciprocal[j];
#pragma GCC unroll 8
        for (int l = 0; l < j; ++l)
#pragma GCC unroll 3
          for (int v = 0; v < vectors; ++v) c[j][v] += c[l][v] * T[l];
      }
    }
    if constexpr (finish == Finish::factor) {
      Vector inverse[columns] = {};
      double pivot[columns];
#pragma GCC unroll 8
      for (int j = 0; j < columns; ++j) inverse[j][j] = 1;
        // Roots are taken afterwards, all of them side by side.
#pragma GCC unroll 8
      for (int j = 0; j < columns; ++j) {
        pivot[j] = c[j][0][j];
        if (!(pivot[j] > 0)) return false;
        const double per_pivot = 1 / pivot[j];
#pragma GCC unroll 8
        for (int l = j + 1; l < columns; ++l) {
          const double share = c[j][0][l] * per_pivot;
          c[l][0] -= share * c[j][0];
          inverse[l] -= share * inverse[j];
        }
      }
#pragma GCC unroll 8
      for (int j = 0; j < columns; ++j) {
        tile.reciprocal[j] = 1 / __builtin_sqrt(pivot[j]);
        c[j][0] = (above(j) ? inverse[j] : c[j][0]) * tile.reciprocal[j];
      }
    }
#pragma GCC unroll 8
    for (int j = 0; j < columns; ++j)
#pragma GCC unroll 3
      for (int v = 0; v < vectors; ++v) store(c[j][v], tile.C + j * tile.C_stride + v * lanes);
    return true;
  }

  template <int vectors, Finish finish>
  static bool run(int columns, const Tile& tile) noexcept {
    if constexpr (lanes > 4) {
      switch (columns) {
        case 8:
          return run<vectors, 8, finish>(tile);
        case 7:
          return run<vectors, 7, finish>(tile);
        case 6:
          return run<vectors, 6, finish>(tile);
        case 5:
          return run<vectors, 5, finish>(tile);
        default:
          break;
      }
    }
    if constexpr (lanes > 2) {
      if (columns == 4) return run<vectors, 4, finish>(tile);
      if (columns == 3) return run<vectors, 3, finish>(tile);
    }
    return columns == 2 ? run<vectors, 2, finish>(tile) : run<vectors, 1, finish>(tile);
  }

  template <Finish finish>
  static bool run(int vectors, int columns, const Tile& tile) noexcept {
    if (vectors == 3) return run<3, finish>(columns, tile);
    return vectors == 2 ? run<2, finish>(columns, tile) : run<1, finish>(columns, tile);
  }

  static int lesser(int a, int b) noexcept { return a < b ? a : b; }
  static int greater(int a, int b) noexcept { return a < b ? b : a; }

  static bool factor_panel(double* P, std::ptrdiff_t stride, int height, int width, double* reciprocal,
                           FrontAhead& ahead) noexcept {
    const auto tile_at = [&](int row, int column) {
      double* C = P + row + column * stride;
      const double* L_JJ = P + column + column * stride;
      return Tile{P + row, P + column,          stride, stride, column, C, stride, L_JJ,
                  stride,  reciprocal + column, &ahead};
    };
    // Row by row of tiles, so that a row of L stays near while the rows above it pass by.
    const int triangle_end = (width + lanes - 1) / lanes * lanes;
    for (int row = 0; row < triangle_end; row += most_vectors * lanes) {
      const int end = lesser(row + most_vectors * lanes, triangle_end);
      for (int column = 0; column < row; column += lanes)
        run<Finish::solve>((end - row) / lanes, lanes, tile_at(row, column));
      for (int column = row; column < end; column += lanes) {
        const int columns = lesser(lanes, width - column);
        if (!run<1, Finish::factor>(columns, tile_at(column, column))) return false;
        if (column + lanes < end)
          run<Finish::solve>((end - column) / lanes - 1, columns, tile_at(column + lanes, column));
      }
    }
    for (int row = triangle_end; row < height; row += most_vectors * lanes)
      for (int column = 0; column < width; column += lanes)
        run<Finish::solve>(lesser(most_vectors, (height - row) / lanes), lesser(lanes, width - column),
                           tile_at(row, column));
    return true;
  }

  static void make_contribution(const double* P, std::ptrdiff_t stride, int height, int width, int size,
                                double* contribution, std::ptrdiff_t contribution_stride,
                                FrontAhead& ahead) noexcept {
    const int origin = contribution_origin(width);
    const int first = width / lanes * lanes;
    for (int row = first; row < height; row += most_vectors * lanes) {
      const int end = lesser(height, row + most_vectors * lanes);
      for (int block = first; block < lesser(end, size); block += lanes) {
        const int column = greater(block, width);
        const int top = greater(row, block);
        double* C = contribution + (top - origin) + (column - width) * contribution_stride;
        const Tile tile{P + top, P + column, stride,  stride, width, C, contribution_stride,
                        nullptr, 0,          nullptr, &ahead};
        run<Finish::none>((end - top) / lanes, lesser(block + lanes, size) - column, tile);
      }
    }
  }

  // Where the first of some rows begins, in whole tiles.
  static int begin_of(const int* begins, int row, int end) noexcept {
    int least = begins[row];
    for (int r = row + 1; r < end; ++r) least = lesser(least, begins[r]);
    return least / lanes * lanes;
  }

  // L_JJ⁻ᵀ of the columns' tile, and of the diagonal.
  static void invert_triangle(const double* L, std::ptrdiff_t stride, int columns, double* triangle,
                              double* reciprocal) noexcept {
    for (int j = 0; j < columns; ++j) reciprocal[j] = 1 / L[j + j * stride];
    for (int l = 0; l < columns; ++l)  // row l of L⁻ᵀ is column l of L⁻¹
      for (int j = l + 1; j < columns; ++j) {
        double sum = L[j + l * stride] * reciprocal[l];
        for (int k = l + 1; k < j; ++k) sum += L[j + k * stride] * triangle[l + k * lanes];
        triangle[l + j * lanes] = -sum * reciprocal[j];
      }
  }

  static void solve_rows(const double* L, std::ptrdiff_t L_stride, int size, const int* begins, int first,
                         int rows, double* Y, std::ptrdiff_t Y_stride, double* inverses) noexcept {
    FrontAhead nothing;
    double* const reciprocal = inverses + lanes * size;
    for (int column = 0; column < size; column += lanes)
      invert_triangle(L + column + column * L_stride, L_stride, lesser(lanes, size - column),
                      inverses + column * lanes, reciprocal + column);
    for (int row = first; row < rows; row += most_vectors * lanes) {
      const int begin = begin_of(begins, row, row + most_vectors * lanes);
      for (int column = begin; column < size; column += lanes) {
        const Tile tile{Y + row + begin * Y_stride,
                        L + column + begin * L_stride,
                        Y_stride,
                        L_stride,
                        column - begin,
                        Y + row + column * Y_stride,
                        Y_stride,
                        inverses + column * lanes,
                        lanes,
                        reciprocal + column,
                        &nothing};
        run<most_vectors, Finish::solve>(lesser(lanes, size - column), tile);
      }
    }
  }

  static void multiply_rows(const double* Y, std::ptrdiff_t Y_stride, int size, const int* begins, int first,
                            int rows, double* C, std::ptrdiff_t C_stride) noexcept {
    FrontAhead nothing;
    for (int row = first; row < rows; row += most_vectors * lanes) {
      const int end = row + most_vectors * lanes, begin = begin_of(begins, row, end);
      for (int column = 0; column < end; column += lanes) {
        const int top = greater(row, column), from = greater(begin, begin_of(begins, column, column + lanes));
        const Tile tile{Y + top + from * Y_stride,
                        Y + column + from * Y_stride,
                        Y_stride,
                        Y_stride,
                        size - from,
                        C + top + column * C_stride,
                        C_stride,
                        nullptr,
                        0,
                        nullptr,
                        &nothing};
        run<Finish::none>((end - top) / lanes, lanes, tile);
      }
    }
  }

  // Columns of a child and where they go. They share their chunks, which are then read once for all of them.
  template <int columns>
  static void add_columns(const double* const* from, double* const* to, const FrontChunk* chunk,
                          const FrontChunk* chunks_end) noexcept {
    for (; chunk != chunks_end; ++chunk) {
      const auto spread = Isa::spread(chunk->mask);
      const std::ptrdiff_t first = chunk->from, row = chunk->row;
#pragma GCC unroll 4
      for (int c = 0; c < columns; ++c) Isa::add(spread, from[c] + first, to[c] + row);
    }
  }

  static void add_child(const double* contribution, std::ptrdiff_t contribution_stride,
                        const FrontChunk* chunk, const FrontChunk* chunks_end, int begin, int end,
                        double* target, std::ptrdiff_t target_stride) noexcept {
    for (; chunk != chunks_end; ++chunk) {
      const double* from[4];
      double* to[4];
      int columns = 0;
      const auto finish = [&] {
        if (columns == 4) add_columns<4>(from, to, chunk + 1, chunks_end);
        if (columns == 3) add_columns<3>(from, to, chunk + 1, chunks_end);
        if (columns == 2) add_columns<2>(from, to, chunk + 1, chunks_end);
        if (columns == 1) add_columns<1>(from, to, chunk + 1, chunks_end);
        columns = 0;
      };
      int c = chunk->from;
      // Of the column's own chunk, the rows from the diagonal on are those whose bits are left.
      for (unsigned left = chunk->mask; left != 0; left &= left - 1, ++c) {
        const int column = chunk->row + __builtin_ctz(left);
        if (column < begin) continue;
        if (column >= end) break;
        from[columns] = contribution + c * contribution_stride;
        to[columns] = target + column * target_stride;
        Isa::add(Isa::spread(left), from[columns] + c, to[columns] + chunk->row);
        if (++columns == 4) finish();
      }
      finish();
      if (chunk->row + row_multiple >= end) return;
    }
  }
};

}  // namespace
}  // namespace hapticd
