#include "physics/compliance/zone/quantised_tiles.h"

namespace hapticd {

namespace {

struct Avx2 {
  using Vector = float __attribute__((vector_size(32)));
  // Through 32-bit integers, for which processors have a conversion.
  static void widen(const std::int16_t* p, Vector& v) noexcept {
    using Narrow = std::int16_t __attribute__((vector_size(16)));
    using Wide = std::int32_t __attribute__((vector_size(32)));
    Narrow q;
    __builtin_memcpy(&q, p, sizeof q);
    v = __builtin_convertvector(__builtin_convertvector(q, Wide), Vector);
  }
};

}  // namespace

constinit const QuantisedKernels avx2_quantised_kernels = {"avx2", QuantisedTiles<Avx2>::forward,
                                                           QuantisedTiles<Avx2>::backward};

}  // namespace hapticd
