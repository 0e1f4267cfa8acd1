#include <immintrin.h>

#include "physics/compliance/front_tiles.h"

namespace hapticd {

namespace {

struct Avx512 {
  using Vector = double __attribute__((vector_size(64)));
  static constexpr int lanes = 8;
  static void add(unsigned mask, const double* from, double* to) noexcept {
    const __m512d spread = _mm512_maskz_expand_pd(static_cast<__mmask8>(mask), _mm512_loadu_pd(from));
    _mm512_store_pd(to, _mm512_add_pd(_mm512_load_pd(to), spread));
  }
};

}  // namespace

constinit const FrontKernels avx512_front_kernels = {"avx512", FrontTiles<Avx512>::factor_panel,
                                                     FrontTiles<Avx512>::make_square,
                                                     FrontTiles<Avx512>::add_child};

}  // namespace hapticd
