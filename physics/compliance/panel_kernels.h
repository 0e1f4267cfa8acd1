// The products and small triangular solves that a solve with a supernodal factor is made of.
//
//   y += P x,   y −= Pᵀ x,   x ← L⁻¹ x,   x ← L⁻ᵀ x
//
// P and L are column-major with leading dimension ld, of doubles with double arithmetic, or of floats or
// 16-bit integers with single. Several columns go at a time, so that vectors are read less often than the
// matrix, which comes from memory. Guarantee: wait-free, no allocation.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>

namespace hapticd::panels {

inline constexpr int register_bytes = 32;

template <typename Real>
inline constexpr int lanes = register_bytes / static_cast<int>(sizeof(Real));

using Doubles = double __attribute__((vector_size(register_bytes)));
using Floats = float __attribute__((vector_size(register_bytes)));

inline Doubles load(const double* p) noexcept {
  Doubles v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

inline Floats load(const float* p) noexcept {
  Floats v;
  std::memcpy(&v, p, sizeof v);
  return v;
}

// Through 32-bit integers, for which processors have a conversion.
inline Floats load(const std::int16_t* p) noexcept {
  using Narrow = std::int16_t __attribute__((vector_size(register_bytes / 2)));
  using Wide = std::int32_t __attribute__((vector_size(register_bytes)));
  Narrow v;
  std::memcpy(&v, p, sizeof v);
  return __builtin_convertvector(__builtin_convertvector(v, Wide), Floats);
}

template <int columns, typename Real, typename Stored>
void add_columns(const Stored* P, int ld, int height, const Real* x, Real* y) noexcept {
  const auto at = [P, ld](int c) { return P + static_cast<std::ptrdiff_t>(c) * ld; };
  int i = 0;
  for (; i + lanes<Real> <= height; i += lanes<Real>) {
    auto sum = load(y + i);
    for (int c = 0; c < columns; ++c) sum += load(at(c) + i) * x[c];
    std::memcpy(y + i, &sum, sizeof sum);
  }
  for (; i < height; ++i)
    for (int c = 0; c < columns; ++c) y[i] += static_cast<Real>(at(c)[i]) * x[c];
}

// y += P x.
template <typename Real, typename Stored>
void add_product(const Stored* P, int ld, int height, int width, const Real* x, Real* y) noexcept {
  const auto at = [P, ld](int c) { return P + static_cast<std::ptrdiff_t>(c) * ld; };
  int j = 0;
  for (; j + 8 <= width; j += 8) add_columns<8>(at(j), ld, height, x + j, y);
  for (; j + 3 <= width; j += 3) add_columns<3>(at(j), ld, height, x + j, y);
  for (; j < width; ++j) add_columns<1>(at(j), ld, height, x + j, y);
}

template <int columns, typename Real, typename Stored>
void subtract_dots(const Stored* P, int ld, int height, const Real* x, Real* y) noexcept {
  const auto at = [P, ld](int c) { return P + static_cast<std::ptrdiff_t>(c) * ld; };
  decltype(load(x)) sum[columns] = {};
  int i = 0;
  for (; i + lanes<Real> <= height; i += lanes<Real>) {
    const auto v = load(x + i);
    for (int c = 0; c < columns; ++c) sum[c] += load(at(c) + i) * v;
  }
  for (int c = 0; c < columns; ++c) {
    Real total = 0;
    for (int l = 0; l < lanes<Real>; ++l) total += sum[c][l];
    for (int k = i; k < height; ++k) total += static_cast<Real>(at(c)[k]) * x[k];
    y[c] -= total;
  }
}

// y −= Pᵀ x.
template <typename Real, typename Stored>
void subtract_transposed(const Stored* P, int ld, int height, int width, const Real* x, Real* y) noexcept {
  const auto at = [P, ld](int c) { return P + static_cast<std::ptrdiff_t>(c) * ld; };
  int j = 0;
  for (; j + 8 <= width; j += 8) subtract_dots<8>(at(j), ld, height, x, y + j);
  for (; j + 3 <= width; j += 3) subtract_dots<3>(at(j), ld, height, x, y + j);
  for (; j < width; ++j) subtract_dots<1>(at(j), ld, height, x, y + j);
}

inline constexpr int triangle_block = 8;  // columns solved one after the other; the rest is products

// x ← L⁻¹ x.
template <typename Real>
void solve_lower(const Real* L, int ld, int size, Real* x) noexcept {
  const auto at = [L, ld](int c) { return L + static_cast<std::ptrdiff_t>(c) * ld; };
  for (int first = 0; first < size; first += triangle_block) {
    const int end = std::min(first + triangle_block, size);
    Real minus[triangle_block];
    for (int j = first; j < end; ++j) {
      x[j] /= at(j)[j];
      minus[j - first] = -x[j];
      for (int i = j + 1; i < end; ++i) x[i] -= at(j)[i] * x[j];
    }
    add_product(at(first) + end, ld, size - end, end - first, minus, x + end);
  }
}

// x ← L⁻ᵀ x.
template <typename Real>
void solve_upper(const Real* L, int ld, int size, Real* x) noexcept {
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
