#include "physics/contact/solver/small_factors.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace hapticd {
namespace {

constexpr int block = 16, strip = 4;   // columns
constexpr double keep_diagonal = 0.1;  // of the largest below it: then it is the pivot, and no row moves

// A typedef: of an alias clang drops `aligned`, and faults.
typedef double Lanes __attribute__((vector_size(32), aligned(8), may_alias));

double* at(double* A, std::ptrdiff_t ld, int i, int j) noexcept { return A + j * ld + i; }
const double* at(const double* A, std::ptrdiff_t ld, int i, int j) noexcept { return A + j * ld + i; }

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
  for (; i + 12 <= rows; i += 12) tile<3, N>(C + i, A + i, B, ld, depth);
  if (rows - i == 8) {
    tile<2, N>(C + i, A + i, B, ld, depth);
  } else if (rows - i == 4) {
    tile<1, N>(C + i, A + i, B, ld, depth);
  }
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

// y −= A x, A of `rows` rows and a strip of columns.
void subtract_strip(const double* A, std::ptrdiff_t ld, int rows, const double* x, double* y) noexcept {
  const double x0 = x[0], x1 = x[1], x2 = x[2], x3 = x[3];
  const double *a = A, *b = A + ld, *c = b + ld, *d = c + ld;
  int i = 0;
  for (; i + 4 <= rows; i += 4)
    *reinterpret_cast<Lanes*>(y + i) -=
        *reinterpret_cast<const Lanes*>(a + i) * x0 + *reinterpret_cast<const Lanes*>(b + i) * x1 +
        *reinterpret_cast<const Lanes*>(c + i) * x2 + *reinterpret_cast<const Lanes*>(d + i) * x3;
  for (; i < rows; ++i) y[i] -= a[i] * x0 + b[i] * x1 + c[i] * x2 + d[i] * x3;
}

// y −= Aᵀ x, A of `rows` rows and a strip of columns.
void subtract_dots(const double* A, std::ptrdiff_t ld, int rows, const double* x, double* y) noexcept {
  Lanes sum[strip] = {};
  int i = 0;
  for (; i + 4 <= rows; i += 4) {
    const Lanes v = *reinterpret_cast<const Lanes*>(x + i);
    for (int j = 0; j < strip; ++j) sum[j] += *reinterpret_cast<const Lanes*>(at(A, ld, i, j)) * v;
  }
  for (; i < rows; ++i)
    for (int j = 0; j < strip; ++j) sum[j][0] += *at(A, ld, i, j) * x[i];
  for (int j = 0; j < strip; ++j) y[j] -= (sum[j][0] + sum[j][1]) + (sum[j][2] + sum[j][3]);
}

// The row of the largest |c_i|, begin ≤ i < end; begin where one is not a number.
int largest_entry(const double* c, int begin, int end) noexcept {
  Lanes most{}, of{};
  const Lanes four{4, 4, 4, 4};
  Lanes row{0, 1, 2, 3};
  int i = begin;
  for (; i + 4 <= end; i += 4, row += four) {
    Lanes v = *reinterpret_cast<const Lanes*>(c + i);
    v = v < 0 ? -v : v;
    const auto more = v > most;
    most = more ? v : most;
    of = more ? row : of;
  }
  int best = begin;
  double largest = std::abs(c[begin]);
  for (int k = 0; k < 4; ++k)
    if (most[k] > largest) {
      largest = most[k];
      best = begin + static_cast<int>(of[k]);
    }
  for (; i < end; ++i)
    if (std::abs(c[i]) > largest) {
      largest = std::abs(c[i]);
      best = i;
    }
  return best;
}

// L⁻¹ x for the unit lower triangle of `width` columns at L, into one column or N of them at once.
template <int N>
inline void substitute(const double* L, int width, double* x, int ld) noexcept {
  for (int j = 0; j < width; ++j) {
    double f[N];
    for (int c = 0; c < N; ++c) f[c] = *at(x, ld, j, c);
    const double* l = at(L, ld, 0, j);
    for (int i = j + 1; i < width; ++i)
      for (int c = 0; c < N; ++c) *at(x, ld, i, c) -= f[c] * l[i];
  }
}

// Strip by strip: L⁻¹ X for the unit lower triangle of `width` columns at L.
void substitute(const double* L, int width, double* X, int ld, int columns) noexcept {
  for (int s = 0; s < width; s += strip) {
    const int deep = std::min(strip, width - s);
    const double* triangle = at(L, ld, s, s);
    double* x = X + s;
    int k = 0;
    for (; k + 4 <= columns; k += 4) substitute<4>(triangle, deep, at(x, ld, 0, k), ld);
    for (; k < columns; ++k) substitute<1>(triangle, deep, at(x, ld, 0, k), ld);
    if (s + deep < width)
      subtract_product(x + deep, triangle + deep, {x, 1, ld}, ld, padded(width) - s - deep, columns, deep);
  }
}

// Columns [begin, end) of rows [begin, n), strip by strip, exchanging whole rows of these columns.
bool factor_panel(double* A, int n, int ld, int begin, int end, int* pivot) noexcept {
  for (int first = begin; first < end; first += strip) {
    const int last = std::min(end, first + strip);
    for (int j = first; j < last; ++j) {
      double* cj = at(A, ld, 0, j);
      int p = largest_entry(cj, j, n);
      if (!(std::abs(cj[p]) > 0) || !std::isfinite(cj[p])) return false;
      if (std::abs(cj[j]) >= keep_diagonal * std::abs(cj[p])) p = j;
      pivot[j] = p;
      if (p != j)
        for (int k = begin; k < end; ++k) std::swap(*at(A, ld, j, k), *at(A, ld, p, k));
      const double inverse = 1 / cj[j];
      for (int i = j + 1; i < n; ++i) cj[i] *= inverse;
      for (int k = j + 1; k < last; ++k) {
        double* ck = at(A, ld, 0, k);
        const double f = ck[j];
        for (int i = j + 1; i < n; ++i) ck[i] -= f * cj[i];
      }
    }
    if (last == end) break;
    substitute(at(A, ld, first, first), last - first, at(A, ld, first, last), ld, end - last);
    subtract_product(at(A, ld, last, last), at(A, ld, last, first), {at(A, ld, first, last), 1, ld}, ld,
                     ld - last, end - last, last - first);
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
    for (int first = begin; first < end; first += strip) {
      const int last = std::min(end, first + strip);
      if (first > begin)
        subtract_product(at(A, ld, first, first), at(A, ld, first, begin), {at(A, ld, first, begin), ld, 1},
                         ld, ld - first, last - first, first - begin);
      for (int j = first; j < last; ++j) {
        double* cj = at(A, ld, 0, j);
        for (int k = first; k < j; ++k) {
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
}

void lower_solve(const double* L, std::ptrdiff_t ld, int n, int rows, double* b) noexcept {
  for (int s = 0; s < n; s += strip) {
    const double* triangle = at(L, ld, s, s);
    const int width = std::min(strip, n - s);
    for (int j = 0; j < width; ++j) {
      b[s + j] /= *at(triangle, ld, j, j);
      for (int i = j + 1; i < width; ++i) b[s + i] -= *at(triangle, ld, i, j) * b[s + j];
    }
    const double* below = triangle + width;
    const int left = rows - s - width;
    if (width == strip) {
      subtract_strip(below, ld, left, b + s, b + s + width);
    } else {
      for (int j = 0; j < width; ++j)
        for (int i = 0; i < left; ++i) b[s + width + i] -= *at(below, ld, i, j) * b[s + j];
    }
  }
}

void lower_transposed_solve(const double* L, std::ptrdiff_t ld, int n, int rows, double* b) noexcept {
  for (int s = (n - 1) / strip * strip; s >= 0 && n > 0; s -= strip) {
    const double* triangle = at(L, ld, s, s);
    const int width = std::min(strip, n - s);
    const double* below = triangle + width;
    const int left = rows - s - width;
    if (width == strip) {
      subtract_dots(below, ld, left, b + s + width, b + s);
    } else {
      for (int j = 0; j < width; ++j)
        for (int i = 0; i < left; ++i) b[s + j] -= *at(below, ld, i, j) * b[s + width + i];
    }
    for (int j = width - 1; j >= 0; --j) {
      for (int i = j + 1; i < width; ++i) b[s + j] -= *at(triangle, ld, i, j) * b[s + i];
      b[s + j] /= *at(triangle, ld, j, j);
    }
  }
}

void cholesky_solve(const double* L, int n, double* b) noexcept {
  lower_solve(L, padded(n), n, n, b);
  lower_transposed_solve(L, padded(n), n, n, b);
}

bool lu_factor(double* A, int n, int* pivot) noexcept {
  const int ld = padded(n);
  for (int begin = 0; begin < n; begin += block) {
    const int end = std::min(n, begin + block);
    if (!factor_panel(A, n, ld, begin, end, pivot)) return false;
    if (end == n) break;
    for (int j = begin; j < end; ++j)
      if (pivot[j] != j)
        for (int k = end; k < n; ++k) std::swap(*at(A, ld, j, k), *at(A, ld, pivot[j], k));
    substitute(at(A, ld, begin, begin), end - begin, at(A, ld, begin, end), ld, n - end);
    subtract_product(at(A, ld, end, end), at(A, ld, end, begin), {at(A, ld, begin, end), 1, ld}, ld, ld - end,
                     n - end, end - begin);
  }
  return true;
}

void lu_solve(const double* LU, int n, const int* pivot, double* b) noexcept {
  const int ld = padded(n);
  for (int s = 0; s < n; s += strip) {
    if (s % block == 0)
      for (int j = s; j < std::min(n, s + block); ++j) std::swap(b[j], b[pivot[j]]);
    const double* triangle = at(LU, ld, s, s);
    const int width = std::min(strip, n - s);
    for (int j = 0; j < width; ++j)
      for (int i = j + 1; i < width; ++i) b[s + i] -= *at(triangle, ld, i, j) * b[s + j];
    if (width == strip) subtract_strip(triangle + strip, ld, n - s - strip, b + s, b + s + strip);
  }
  for (int s = (n - 1) / strip * strip; s >= 0; s -= strip) {
    const double* triangle = at(LU, ld, s, s);
    const int width = std::min(strip, n - s);
    for (int j = width - 1; j >= 0; --j) {
      b[s + j] /= *at(triangle, ld, j, j);
      for (int i = 0; i < j; ++i) b[s + i] -= *at(triangle, ld, i, j) * b[s + j];
    }
    if (width == strip) {
      subtract_strip(at(LU, ld, 0, s), ld, s, b + s, b);
    } else {
      for (int j = 0; j < width; ++j)
        for (int i = 0; i < s; ++i) b[i] -= *at(LU, ld, i, s + j) * b[s + j];
    }
  }
}

}  // namespace hapticd
