// Cholesky and LU of the small dense blocks of contact solvers, in place, without Eigen's heap.
//
//   A = L Lᵀ (lower triangle),   P A = L U (partial pivoting)
//
// Column-major with leading dimension n. A Cholesky pivot that is not above `floor` · its diagonal entry
// is raised to it, so that the factor is finite also where rounding has eaten a tiny relative diagonal.
// Guarantee: wait-free, no allocation, n³/3 and 2n³/3 flops.
#pragma once

#include <cmath>
#include <cstddef>
#include <utility>

namespace hapticd {

inline void cholesky(double* A, int n, double floor) noexcept {
  for (int j = 0; j < n; ++j) {
    double* cj = A + static_cast<std::ptrdiff_t>(j) * n;
    const double diagonal = cj[j];
    for (int k = 0; k < j; ++k) {
      const double* ck = A + static_cast<std::ptrdiff_t>(k) * n;
      const double f = ck[j];
      if (f == 0) continue;
      for (int i = j; i < n; ++i) cj[i] -= f * ck[i];
    }
    if (!(cj[j] > floor * diagonal)) cj[j] = floor * diagonal;
    const double pivot = std::sqrt(cj[j]);
    cj[j] = pivot;
    for (int i = j + 1; i < n; ++i) cj[i] /= pivot;
  }
}

inline void cholesky_solve(const double* L, int n, double* b) noexcept {
  for (int j = 0; j < n; ++j) {
    const double* c = L + static_cast<std::ptrdiff_t>(j) * n;
    b[j] /= c[j];
    for (int i = j + 1; i < n; ++i) b[i] -= c[i] * b[j];
  }
  for (int j = n - 1; j >= 0; --j) {
    const double* c = L + static_cast<std::ptrdiff_t>(j) * n;
    double sum = b[j];
    for (int i = j + 1; i < n; ++i) sum -= c[i] * b[i];
    b[j] = sum / c[j];
  }
}

// Solves A x = b in place (A is destroyed). False where A is singular to working precision.
inline bool lu_solve(double* A, int n, double* b) noexcept {
  for (int j = 0; j < n; ++j) {
    double* cj = A + static_cast<std::ptrdiff_t>(j) * n;
    int p = j;
    for (int i = j + 1; i < n; ++i)
      if (std::abs(cj[i]) > std::abs(cj[p])) p = i;
    if (!(std::abs(cj[p]) > 0) || !std::isfinite(cj[p])) return false;
    if (p != j) {
      for (int k = j; k < n; ++k) {
        double* ck = A + static_cast<std::ptrdiff_t>(k) * n;
        std::swap(ck[j], ck[p]);
      }
      std::swap(b[j], b[p]);
    }
    const double inverse = 1.0 / cj[j];
    for (int i = j + 1; i < n; ++i) cj[i] *= inverse;
    for (int k = j + 1; k < n; ++k) {
      double* ck = A + static_cast<std::ptrdiff_t>(k) * n;
      const double f = ck[j];
      if (f == 0) continue;
      for (int i = j + 1; i < n; ++i) ck[i] -= f * cj[i];
    }
    for (int i = j + 1; i < n; ++i) b[i] -= cj[i] * b[j];
  }
  for (int j = n - 1; j >= 0; --j) {
    const double* cj = A + static_cast<std::ptrdiff_t>(j) * n;
    b[j] /= cj[j];
    for (int i = 0; i < j; ++i) b[i] -= cj[i] * b[j];
  }
  return true;
}

}  // namespace hapticd
