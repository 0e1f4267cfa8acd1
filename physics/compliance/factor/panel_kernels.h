// The products and small triangular solves that a solve with a supernodal factor is made of.
//
//   y += P x,   y −= Pᵀ x,   x ← L⁻¹ x,   x ← L⁻ᵀ x
//
// P and L are column-major with leading dimension ld. Several columns go at a time, so that vectors are read
// less often than the matrix, which comes from memory. Guarantee: wait-free, no allocation.
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

template <int columns>
void add_columns(const double* P, int ld, int height, const double* x, double* y) noexcept {
  const auto at = [P, ld](int c) { return P + static_cast<std::ptrdiff_t>(c) * ld; };
  int i = 0;
  for (; i + lanes <= height; i += lanes) {
    auto sum = load(y + i);
    for (int c = 0; c < columns; ++c) sum += load(at(c) + i) * x[c];
    std::memcpy(y + i, &sum, sizeof sum);
  }
  for (; i < height; ++i)
    for (int c = 0; c < columns; ++c) y[i] += at(c)[i] * x[c];
}

// y += P x.
inline void add_product(const double* P, int ld, int height, int width, const double* x, double* y) noexcept {
  const auto at = [P, ld](int c) { return P + static_cast<std::ptrdiff_t>(c) * ld; };
  int j = 0;
  for (; j + 8 <= width; j += 8) add_columns<8>(at(j), ld, height, x + j, y);
  for (; j + 3 <= width; j += 3) add_columns<3>(at(j), ld, height, x + j, y);
  for (; j < width; ++j) add_columns<1>(at(j), ld, height, x + j, y);
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

// x ← L⁻¹ x.
inline void solve_lower(const double* L, int ld, int size, double* x) noexcept {
  const auto at = [L, ld](int c) { return L + static_cast<std::ptrdiff_t>(c) * ld; };
  for (int first = 0; first < size; first += triangle_block) {
    const int end = std::min(first + triangle_block, size);
    double minus[triangle_block];
    for (int j = first; j < end; ++j) {
      x[j] /= at(j)[j];
      minus[j - first] = -x[j];
      for (int i = j + 1; i < end; ++i) x[i] -= at(j)[i] * x[j];
    }
    add_product(at(first) + end, ld, size - end, end - first, minus, x + end);
  }
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
