// Cholesky and LU of the small dense blocks of contact solvers, in place, without heap or library.
//
//   A = L Lᵀ (lower triangle),   P A = L U (the diagonal while it is a tenth of the largest below it)
//
// Column-major with leading dimension ld = padded(n), a multiple of 4; rows n … ld − 1 of every column must
// be zero. Blocks of 16 columns, within them strips of 4, updated in tiles of 12 × 4 registers: at n = 130
// the LU runs at 37 GFLOP/s, Cholesky at 44 (core's peak 59). The LU's exchanges are not applied to the
// blocks left of them; its solve makes them when it comes there. A Cholesky pivot that is not above `floor` ·
// its diagonal entry is raised to it, so that the factor is finite also where rounding has eaten a tiny
// relative diagonal. Guarantee: wait-free, no allocation, n³/3 and 2n³/3 flops; the solves 2n².
#pragma once

#include <cstddef>

namespace hapticd {

constexpr int padded(int n) noexcept { return (n + 3) / 4 * 4; }

void cholesky(double* A, int n, double floor) noexcept;
void cholesky_solve(const double* L, int n, double* b) noexcept;

// L: n lower triangular columns of `rows` ≥ n rows, leading dimension ld. b[0 … n) ← L⁻¹ b[0 … n), and what
// the rows below the triangle give is taken from b[n … rows); the second: b[0 … n) ← L⁻ᵀ (b[0 … n) − L₂ᵀ b[n
// …)).
void lower_solve(const double* L, std::ptrdiff_t ld, int n, int rows, double* b) noexcept;
void lower_transposed_solve(const double* L, std::ptrdiff_t ld, int n, int rows, double* b) noexcept;

// pivot: n row exchanges. False where A is singular to working precision or not finite.
bool lu_factor(double* A, int n, int* pivot) noexcept;
void lu_solve(const double* LU, int n, const int* pivot, double* b) noexcept;

}  // namespace hapticd
