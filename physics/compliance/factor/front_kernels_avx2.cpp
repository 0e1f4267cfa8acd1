#include <immintrin.h>

#include "physics/compliance/factor/front_tiles.h"

namespace hapticd {

namespace {

// For each mask of four lanes: the halves of which numbers go there, and whether any does.
struct Halves {
  int half[16][8];
  long long keep[16][4];
};
constexpr Halves halves = [] {
  Halves s{};
  for (int mask = 0; mask < 16; ++mask)
    for (int lane = 0, from = 0; lane < 4; ++lane) {
      if ((mask >> lane & 1) == 0) continue;
      s.half[mask][2 * lane] = 2 * from;
      s.half[mask][2 * lane + 1] = 2 * from + 1;
      s.keep[mask][lane] = -1;
      ++from;
    }
  return s;
}();

struct Avx2 {
  using Vector = double __attribute__((vector_size(32)));
  static constexpr int lanes = 4;
  static unsigned spread(unsigned mask) noexcept { return mask; }
  static void add(unsigned mask, const double* from, double* to) noexcept {
    add_four(mask & 15, from, to);
    add_four(mask >> 4, from + __builtin_popcount(mask & 15), to + 4);
  }

 private:
  static void add_four(unsigned mask, const double* from, double* to) noexcept {
    const __m256 numbers = _mm256_castpd_ps(_mm256_loadu_pd(from));
    const __m256i half = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(halves.half[mask]));
    const __m256d keep = _mm256_loadu_pd(reinterpret_cast<const double*>(halves.keep[mask]));
    const __m256d there = _mm256_and_pd(keep, _mm256_castps_pd(_mm256_permutevar8x32_ps(numbers, half)));
    _mm256_storeu_pd(to, _mm256_add_pd(_mm256_loadu_pd(to), there));
  }
};

}  // namespace

constinit const FrontKernels avx2_front_kernels = {"avx2",
                                                   FrontTiles<Avx2>::factor_panel,
                                                   FrontTiles<Avx2>::make_contribution,
                                                   FrontTiles<Avx2>::add_child,
                                                   FrontTiles<Avx2>::solve_rows,
                                                   FrontTiles<Avx2>::multiply_rows};

}  // namespace hapticd
