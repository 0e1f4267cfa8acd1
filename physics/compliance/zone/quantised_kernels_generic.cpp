#include "physics/compliance/zone/quantised_tiles.h"

namespace hapticd {

namespace {

struct Generic {
  using Vector = float __attribute__((vector_size(16)));
  // Through 32-bit integers, for which processors have a conversion.
  static void widen(const std::int16_t* p, Vector& v) noexcept {
    using Narrow = std::int16_t __attribute__((vector_size(8)));
    using Wide = std::int32_t __attribute__((vector_size(16)));
    Narrow q;
    __builtin_memcpy(&q, p, sizeof q);
    v = __builtin_convertvector(__builtin_convertvector(q, Wide), Vector);
  }
};

}  // namespace

constinit const QuantisedKernels generic_quantised_kernels = {"generic", QuantisedTiles<Generic>::forward,
                                                              QuantisedTiles<Generic>::backward};

}  // namespace hapticd
