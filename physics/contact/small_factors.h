// Cholesky and LU of the small dense blocks of contact solvers, in place, without heap or library.
//
//   A = L Lᵀ (lower triangle),   P A = L U (partial pivoting)
//
// Column-major with leading dimension ld = padded(n), a multiple of 4; rows n … ld − 1 of every column must
// be zero. Blocks of 16 columns, updated in tiles of 8 × 4 registers: 18 GFLOP/s at n = 100 and above (core's
// peak 59) where plain columns reach 4. A Cholesky pivot that is not above `floor` · its diagonal entry is
// raised to it, so that the factor is finite also where rounding has eaten a tiny relative diagonal.
// Guarantee: wait-free, no allocation, n³/3 and 2n³/3 flops; the solves 2n².
#pragma once

namespace hapticd {

constexpr int padded(int n) noexcept { return (n + 3) / 4 * 4; }

void cholesky(double* A, int n, double floor) noexcept;
void cholesky_solve(const double* L, int n, double* b) noexcept;

// pivot: n row exchanges. False where A is singular to working precision or not finite.
bool lu_factor(double* A, int n, int* pivot) noexcept;
void lu_solve(const double* LU, int n, const int* pivot, double* b) noexcept;

}  // namespace hapticd
