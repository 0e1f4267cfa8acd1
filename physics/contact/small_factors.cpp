#include "physics/contact/small_factors.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace hapticd {
namespace {

constexpr int block = 16;

using Lanes = double __attribute__((vector_size(32), aligned(8), may_alias));

double* at(double* A, int ld, int i, int j) noexcept { return A + static_cast<std::ptrdiff_t>(j) * ld + i; }
const double* at(const double* A, int ld, int i, int j) noexcept {
  return A + static_cast<std::ptrdiff_t>(j) * ld + i;
}

// A strided view of the right factor: B(k, j) = data[k · by_k + j · by_j].
struct Right {
  const double* data;
  std::ptrdiff_t by_k, by_j;
};

// One tile of 4 V rows and N columns: C −= A B over `depth`.
template <int V, int N>
inline void tile(double* C, const double* A, const Right& B, int ld, int depth) noexcept {
  Lanes sum[V][N];
  for (int j = 0; j < N; ++j)
    for (int v = 0; v < V; ++v) sum[v][j] = *reinterpret_cast<const Lanes*>(at(C, ld, 4 * v, j));
  for (int k = 0; k < depth; ++k) {
    Lanes a[V];
    for (int v = 0; v < V; ++v) a[v] = *reinterpret_cast<const Lanes*>(at(A, ld, 4 * v, k));
    for (int j = 0; j < N; ++j) {
      const double b = B.data[k * B.by_k + j * B.by_j];
      for (int v = 0; v < V; ++v) sum[v][j] -= a[v] * b;
    }
  }
  for (int j = 0; j < N; ++j)
    for (int v = 0; v < V; ++v) *reinterpret_cast<Lanes*>(at(C, ld, 4 * v, j)) = sum[v][j];
}

template <int N>
inline void tile_columns(double* C, const double* A, const Right& B, int ld, int rows, int depth) noexcept {
  int i = 0;
  for (; i + 8 <= rows; i += 8) tile<2, N>(C + i, A + i, B, ld, depth);
  for (; i < rows; i += 4) tile<1, N>(C + i, A + i, B, ld, depth);
}

// C −= A B; rows a multiple of 4, C and A with leading dimension ld.
void subtract_product(double* C, const double* A, const Right& B, int ld, int rows, int columns,
                      int depth) noexcept {
  int j = 0;
  for (; j + 4 <= columns; j += 4)
    tile_columns<4>(at(C, ld, 0, j), A, {B.data + j * B.by_j, B.by_k, B.by_j}, ld, rows, depth);
  for (; j < columns; ++j)
    tile_columns<1>(at(C, ld, 0, j), A, {B.data + j * B.by_j, B.by_k, B.by_j}, ld, rows, depth);
}

// Columns [begin, end) of rows [begin, n) by rank-one updates, exchanging whole rows of these columns.
bool factor_panel(double* A, int n, int ld, int begin, int end, int* pivot) noexcept {
  for (int j = begin; j < end; ++j) {
    double* cj = at(A, ld, 0, j);
    int p = j;
    double largest = std::abs(cj[j]);
    for (int i = j + 1; i < n; ++i)
      if (std::abs(cj[i]) > largest) {
        largest = std::abs(cj[i]);
        p = i;
      }
    pivot[j] = p;
    if (!(largest > 0) || !std::isfinite(cj[p])) return false;
    if (p != j)
      for (int k = begin; k < end; ++k) std::swap(*at(A, ld, j, k), *at(A, ld, p, k));
    const double inverse = 1 / cj[j];
    for (int i = j + 1; i < n; ++i) cj[i] *= inverse;
    for (int k = j + 1; k < end; ++k) {
      double* ck = at(A, ld, 0, k);
      const double f = ck[j];
      if (f == 0) continue;
      for (int i = j + 1; i < n; ++i) ck[i] -= f * cj[i];
    }
  }
  return true;
}

}  // namespace

void cholesky(double* A, int n, double floor) noexcept {
  const int ld = padded(n);
  for (int begin = 0; begin < n; begin += block) {
    const int end = std::min(n, begin + block);
    std::array<double, block> diagonal;
    for (int j = begin; j < end; ++j) diagonal[j - begin] = *at(A, ld, j, j);
    if (begin > 0)
      subtract_product(at(A, ld, begin, begin), at(A, ld, begin, 0), {at(A, ld, begin, 0), ld, 1}, ld,
                       ld - begin, end - begin, begin);
    for (int j = begin; j < end; ++j) {
      double* cj = at(A, ld, 0, j);
      for (int k = begin; k < j; ++k) {
        const double* ck = at(A, ld, 0, k);
        const double f = ck[j];
        for (int i = j; i < n; ++i) cj[i] -= f * ck[i];
      }
      const double least = floor * diagonal[j - begin];
      if (!(cj[j] > least)) cj[j] = least;
      const double root = std::sqrt(cj[j]), inverse = 1 / root;
      cj[j] = root;
      for (int i = j + 1; i < n; ++i) cj[i] *= inverse;
    }
  }
}

void cholesky_solve(const double* L, int n, double* b) noexcept {
  const int ld = padded(n);
  for (int j = 0; j < n; ++j) {
    const double* c = at(L, ld, 0, j);
    const double x = b[j] /= c[j];
    for (int i = j + 1; i < n; ++i) b[i] -= c[i] * x;
  }
  for (int j = n - 1; j >= 0; --j) {
    const double* c = at(L, ld, 0, j);
    double sum[4] = {b[j], 0, 0, 0};
    int i = j + 1;
    for (; i + 4 <= n; i += 4)
      for (int k = 0; k < 4; ++k) sum[k] -= c[i + k] * b[i + k];
    for (; i < n; ++i) sum[0] -= c[i] * b[i];
    b[j] = ((sum[0] + sum[1]) + (sum[2] + sum[3])) / c[j];
  }
}

bool lu_factor(double* A, int n, int* pivot) noexcept {
  const int ld = padded(n);
  for (int begin = 0; begin < n; begin += block) {
    const int end = std::min(n, begin + block);
    if (!factor_panel(A, n, ld, begin, end, pivot)) return false;
    for (int k = 0; k < n; ++k) {
      if (k == begin) k = end;
      if (k >= n) break;
      double* ck = at(A, ld, 0, k);
      for (int j = begin; j < end; ++j) std::swap(ck[j], ck[pivot[j]]);
      if (k < end) continue;
      for (int j = begin; j < end; ++j) {
        const double f = ck[j];
        const double* cj = at(A, ld, 0, j);
        for (int i = j + 1; i < end; ++i) ck[i] -= f * cj[i];
      }
    }
    if (end < n)
      subtract_product(at(A, ld, end, end), at(A, ld, end, begin), {at(A, ld, begin, end), 1, ld}, ld,
                       ld - end, n - end, end - begin);
  }
  return true;
}

void lu_solve(const double* LU, int n, const int* pivot, double* b) noexcept {
  const int ld = padded(n);
  for (int j = 0; j < n; ++j) std::swap(b[j], b[pivot[j]]);
  for (int j = 0; j < n; ++j) {
    const double* c = at(LU, ld, 0, j);
    const double x = b[j];
    for (int i = j + 1; i < n; ++i) b[i] -= c[i] * x;
  }
  for (int j = n - 1; j >= 0; --j) {
    const double* c = at(LU, ld, 0, j);
    const double x = b[j] /= c[j];
    for (int i = 0; i < j; ++i) b[i] -= c[i] * x;
  }
}

}  // namespace hapticd
