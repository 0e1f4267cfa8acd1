// The products and small triangular solves that a solve with a supernodal factor is made of.
//
//   Y += P X,   y −= Pᵀ x,   X ← L⁻¹ X,   x ← L⁻ᵀ x
//
// P and L are column-major with leading dimension ld, X and Y of any number of right-hand sides with leading
// dimensions ldx and ldy. Several columns of P go at a time with several right-hand sides, so that what comes
// from memory, the matrix, is read once. Guarantee: wait-free, no allocation.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>

namespace hapticd::panels {

inline constexpr int register_bytes = 32;

inline constexpr int lanes = register_bytes / static_cast<int>(sizeof(double));

using Doubles = double __attribute__((vector_size(register_bytes)));

inline Doubles load(const double* p) noexcept {
  Doubles v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

inline constexpr int most_sides = 3;  // right-hand sides at a time

template <int columns, int sides>
void add_columns(const double* P, int ld, int height, const double* X, std::ptrdiff_t ldx, double* Y,
                 std::ptrdiff_t ldy) noexcept {
  const auto at = [P, ld](int c) { return P + static_cast<std::ptrdiff_t>(c) * ld; };
  Doubles factor[sides][columns];  // of their own: a store to Y could change X
  for (int s = 0; s < sides; ++s)
    for (int c = 0; c < columns; ++c) factor[s][c] = Doubles{} + X[s * ldx + c];
  int i = 0;
  for (; i + lanes <= height; i += lanes) {
    Doubles p[columns];
    for (int c = 0; c < columns; ++c) p[c] = load(at(c) + i);
    for (int s = 0; s < sides; ++s) {
      auto sum = load(Y + s * ldy + i);
      for (int c = 0; c < columns; ++c) sum += p[c] * factor[s][c];
      std::memcpy(Y + s * ldy + i, &sum, sizeof sum);
    }
  }
  for (; i < height; ++i)
    for (int s = 0; s < sides; ++s)
      for (int c = 0; c < columns; ++c) Y[s * ldy + i] += at(c)[i] * factor[s][c][0];
}

template <int columns>
void add_columns(const double* P, int ld, int height, const double* X, std::ptrdiff_t ldx, double* Y,
                 std::ptrdiff_t ldy, int sides) noexcept {
  int s = 0;
  for (; s + most_sides <= sides; s += most_sides)
    add_columns<columns, most_sides>(P, ld, height, X + s * ldx, ldx, Y + s * ldy, ldy);
  for (; s < sides; ++s) add_columns<columns, 1>(P, ld, height, X + s * ldx, ldx, Y + s * ldy, ldy);
}

// Y += P X.
inline void add_product(const double* P, int ld, int height, int width, const double* X, std::ptrdiff_t ldx,
                        double* Y, std::ptrdiff_t ldy, int sides) noexcept {
  const auto at = [P, ld](int c) { return P + static_cast<std::ptrdiff_t>(c) * ld; };
  int j = 0;
  for (; j + 8 <= width; j += 8) add_columns<8>(at(j), ld, height, X + j, ldx, Y, ldy, sides);
  for (; j + 3 <= width; j += 3) add_columns<3>(at(j), ld, height, X + j, ldx, Y, ldy, sides);
  for (; j < width; ++j) add_columns<1>(at(j), ld, height, X + j, ldx, Y, ldy, sides);
}

// y += P x.
inline void add_product(const double* P, int ld, int height, int width, const double* x, double* y) noexcept {
  add_product(P, ld, height, width, x, 0, y, 0, 1);
}

template <int columns>
void subtract_dots(const double* P, int ld, int height, const double* x, double* y) noexcept {
  const auto at = [P, ld](int c) { return P + static_cast<std::ptrdiff_t>(c) * ld; };
  Doubles sum[columns] = {};
  int i = 0;
  for (; i + lanes <= height; i += lanes) {
    const auto v = load(x + i);
    for (int c = 0; c < columns; ++c) sum[c] += load(at(c) + i) * v;
  }
  for (int c = 0; c < columns; ++c) {
    double total = 0;
    for (int l = 0; l < lanes; ++l) total += sum[c][l];
    for (int k = i; k < height; ++k) total += at(c)[k] * x[k];
    y[c] -= total;
  }
}

// y −= Pᵀ x.
inline void subtract_transposed(const double* P, int ld, int height, int width, const double* x,
                                double* y) noexcept {
  const auto at = [P, ld](int c) { return P + static_cast<std::ptrdiff_t>(c) * ld; };
  int j = 0;
  for (; j + 8 <= width; j += 8) subtract_dots<8>(at(j), ld, height, x, y + j);
  for (; j + 3 <= width; j += 3) subtract_dots<3>(at(j), ld, height, x, y + j);
  for (; j < width; ++j) subtract_dots<1>(at(j), ld, height, x, y + j);
}

inline constexpr int triangle_block = 8;  // columns solved one after the other; the rest is products

// X ← L⁻¹ X.
inline void solve_lower(const double* L, int ld, int size, double* X, std::ptrdiff_t ldx,
                        int sides) noexcept {
  const auto at = [L, ld](int c) { return L + static_cast<std::ptrdiff_t>(c) * ld; };
  for (int first = 0; first < size; first += triangle_block) {
    const int end = std::min(first + triangle_block, size);
    for (int s = 0; s < sides; s += most_sides) {
      const int count = std::min(most_sides, sides - s);
      double minus[most_sides][triangle_block];
      for (int k = 0; k < count; ++k) {
        double* x = X + (s + k) * ldx;
        for (int j = first; j < end; ++j) {
          x[j] /= at(j)[j];
          minus[k][j - first] = -x[j];
          for (int i = j + 1; i < end; ++i) x[i] -= at(j)[i] * x[j];
        }
      }
      add_product(at(first) + end, ld, size - end, end - first, minus[0], triangle_block, X + s * ldx + end,
                  ldx, count);
    }
  }
}

// x ← L⁻¹ x.
inline void solve_lower(const double* L, int ld, int size, double* x) noexcept {
  solve_lower(L, ld, size, x, 0, 1);
}

// x ← L⁻ᵀ x.
inline void solve_upper(const double* L, int ld, int size, double* x) noexcept {
  const auto at = [L, ld](int c) { return L + static_cast<std::ptrdiff_t>(c) * ld; };
  for (int first = (size - 1) / triangle_block * triangle_block; first >= 0; first -= triangle_block) {
    const int end = std::min(first + triangle_block, size);
    subtract_transposed(at(first) + end, ld, size - end, end - first, x + end, x + first);
    for (int j = end - 1; j >= first; --j) {
      for (int i = j + 1; i < end; ++i) x[j] -= at(j)[i] * x[i];
      x[j] /= at(j)[j];
    }
  }
}

}  // namespace hapticd::panels
