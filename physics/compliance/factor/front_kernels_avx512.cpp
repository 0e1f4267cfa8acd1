#include <immintrin.h>

#include "physics/compliance/factor/front_tiles.h"

namespace hapticd {

namespace {

// For each mask of eight lanes, which number goes there. As an index once for several columns: to expand each
// by the mask itself takes eight cycles, to permute it one.
struct Indices {
  alignas(64) long long of[256][8];
};
constexpr Indices indices = [] {
  Indices i{};
  for (int mask = 0; mask < 256; ++mask)
    for (int lane = 0, from = 0; lane < 8; ++lane)
      if ((mask >> lane & 1) != 0) i.of[mask][lane] = from++;
  return i;
}();

struct Avx512 {
  using Vector = double __attribute__((vector_size(64)));
  static constexpr int lanes = 8;
  struct Spread {
    unsigned mask;
    __m512i index;
  };
  static Spread spread(unsigned mask) noexcept { return {mask, _mm512_load_si512(indices.of[mask])}; }
  static void add(const Spread& spread, const double* from, double* to) noexcept {
    const __m512d there =
        _mm512_maskz_permutexvar_pd(static_cast<__mmask8>(spread.mask), spread.index, _mm512_loadu_pd(from));
    _mm512_store_pd(to, _mm512_add_pd(_mm512_load_pd(to), there));
  }
};

}  // namespace

constinit const FrontKernels avx512_front_kernels = {"avx512",
                                                     FrontTiles<Avx512>::factor_panel,
                                                     FrontTiles<Avx512>::make_contribution,
                                                     FrontTiles<Avx512>::add_child,
                                                     FrontTiles<Avx512>::solve_rows,
                                                     FrontTiles<Avx512>::multiply_rows};

}  // namespace hapticd
