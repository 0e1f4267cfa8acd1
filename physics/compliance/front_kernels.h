// The dense arithmetic of one front: a partial Cholesky factorisation, and the square it leaves behind.
//
//   [F11 .  ]   [L11    ] [L11ᵀ L21ᵀ]
//   [F21 F22] = [L21  I ] [      U  ],    factor_panel: F11, F21 → L11, L21    subtract_square: F22 → U
//
// Both are products C −= A Bᵀ on tiles that stay in registers, three vectors high and one vector's length
// wide; in the panel each tile ends with its triangular solve before it is stored. The panel has `height`
// rows, a multiple of `row_multiple`, in columns of `stride` numbers aligned to 64 bytes; the first `width`
// rows are F11. The square's columns begin at row `square_origin(width)` of the panel, so that its tiles are
// aligned with the panel's. Rows from the true height on, and entries above the diagonal, hold numbers of no
// meaning and are kept finite. Chosen at start from what the processor can do; all are the same template.
// Guarantee: wait-free, no allocation. Units: F [N/m].
#pragma once

#include <cstddef>

namespace hapticd {

struct FrontKernels {
  const char* name;
  // False: a pivot is not positive (or not a number). `reciprocal` gets 1 / L_jj of every column.
  bool (*factor_panel)(double* panel, std::ptrdiff_t stride, int height, int width,
                       double* reciprocal) noexcept;
  // Lower triangle of rows and columns `width` to `size`; `fresh`: F22 is zero, whatever the memory holds.
  void (*subtract_square)(const double* panel, std::ptrdiff_t stride, int height, int width, int size,
                          double* square, std::ptrdiff_t square_stride, bool fresh) noexcept;
};

inline constexpr int row_multiple = 8;

constexpr int square_origin(int width) noexcept { return width / row_multiple * row_multiple; }

extern const FrontKernels generic_front_kernels;
extern const FrontKernels avx2_front_kernels;    // to be called only where the processor has AVX2 and FMA
extern const FrontKernels avx512_front_kernels;  // … AVX-512F

// The best that this processor runs.
const FrontKernels& front_kernels() noexcept;

}  // namespace hapticd
