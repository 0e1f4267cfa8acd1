// The dense arithmetic of one front: a partial Cholesky factorisation, and the contribution block it leaves
// behind.
//
//   [F11 .  ]   [L11    ] [L11ᵀ L21ᵀ]
//   [F21 F22] = [L21  I ] [      U  ],    factor_panel: F11, F21 → L11, L21    make_contribution: U − F22
//
// Both are products C −= A Bᵀ on tiles that stay in registers, three vectors high and one vector's length
// wide; in the panel each tile ends with its triangular solve before it is stored. The panel has `height`
// rows, a multiple of `row_multiple`, in columns of `stride` numbers aligned to 64 bytes; the first `width`
// rows are F11. The contribution block's columns begin at row `contribution_origin(width)` of the panel, so
// that its tiles are aligned with the panel's. Above the diagonal, L11's tiles on it hold their L_JJ⁻ᵀ, with
// which those below are solved; other entries there, and rows from the true height on, have no meaning and
// are kept finite. What children add goes into the panel before, into the contribution block after: so the
// contribution block is written once, without having been cleared or read. Their rows are ascending in the
// parent too, so eight of the parent's at a time are some of the child's, in its order: a mask says which
// (`FrontChunk`). The same tiles solve for rows of a factor's inverse and multiply them. Chosen at start from
// what the processor can do; all are the same template. Guarantee: wait-free, no allocation. Units: F [N/m].
#pragma once

#include <cstddef>

namespace hapticd {

// Rows `row` to `row + 7` of a front, of which a child has those with a bit in `mask`; its first is `from`.
struct FrontChunk {
  int row;  // a multiple of row_multiple
  int from;
  unsigned mask;
};

// Memory that is wanted next: the kernels fetch it while they compute, a few lines with each tile, into the
// second-level cache. A panel of L was last touched a step ago, and would else be waited for. Small fronts
// have few tiles: so the tiles of large ones fetch for several of them, as far as `window`.
struct FrontAhead {
  static constexpr std::ptrdiff_t window = 96 << 10;  // bytes

  const char* next = nullptr;
  const char* end = nullptr;

  // What is wanted next begins here, and all of it ends there.
  void move(const double* begin, const double* all_end) noexcept {
    const auto* from = reinterpret_cast<const char*>(begin);
    const auto* to = reinterpret_cast<const char*>(all_end);
    if (next < from) next = from;
    end = to - from < window ? to : from + window;
  }

  void fetch() noexcept {
    constexpr int line = 64;
    constexpr int lines = 8;
    if (next >= end) return;
    for (int l = 0; l < lines; ++l) __builtin_prefetch(next + l * line, 1, 3);
    next += lines * line;
  }
};

struct FrontKernels {
  const char* name;
  // False: a pivot is not positive (or not a number). `reciprocal` gets 1 / L_jj of every column.
  bool (*factor_panel)(double* panel, std::ptrdiff_t stride, int height, int width, double* reciprocal,
                       FrontAhead& ahead) noexcept;
  // contribution block = −L21 L21ᵀ, whatever was there: the lower triangle of rows and columns `width` to
  // `size`.
  void (*make_contribution)(const double* panel, std::ptrdiff_t stride, int height, int width, int size,
                            double* contribution, std::ptrdiff_t contribution_stride,
                            FrontAhead& ahead) noexcept;
  // The lower triangle of a child's contribution block, by its own rows, to columns `begin` to `end` of its
  // parent: those of `target`, by the parent's rows and columns. Reads up to seven numbers behind a column of
  // the contribution block.
  void (*add_child)(const double* contribution, std::ptrdiff_t contribution_stride, const FrontChunk* chunks,
                    const FrontChunk* chunks_end, int begin, int end, double* target,
                    std::ptrdiff_t target_stride) noexcept;
  // Rows `first` to `rows` of Y ← Y L⁻ᵀ, L of `size` rows; row r is zero before column begins[r]. Both are
  // multiples of `most_tile_rows`. Of each so many rows what is before their least column, rounded down to a
  // row_multiple, is not read; the rest has to be set. inverses: room for size (row_multiple + 1) numbers.
  void (*solve_rows)(const double* L, std::ptrdiff_t L_stride, int size, const int* begins, int first,
                     int rows, double* Y, std::ptrdiff_t Y_stride, double* inverses) noexcept;
  // C = −Y Yᵀ: rows `first` to `rows` of its lower triangle, and what is above it in tiles on the diagonal.
  void (*multiply_rows)(const double* Y, std::ptrdiff_t Y_stride, int size, const int* begins, int first,
                        int rows, double* C, std::ptrdiff_t C_stride) noexcept;
};

inline constexpr int row_multiple = 8;
inline constexpr int most_tile_rows = 24;

constexpr int contribution_origin(int width) noexcept { return width / row_multiple * row_multiple; }

extern const FrontKernels generic_front_kernels;
extern const FrontKernels avx2_front_kernels;    // to be called only where the processor has AVX2 and FMA
extern const FrontKernels avx512_front_kernels;  // … AVX-512F

// The best that this processor runs.
const FrontKernels& front_kernels() noexcept;

}  // namespace hapticd
