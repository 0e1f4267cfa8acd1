#include "physics/compliance/front_tiles.h"

namespace hapticd {

namespace {

struct Avx512 {
  using Vector = double __attribute__((vector_size(64)));
  static constexpr int lanes = 8;
};

}  // namespace

constinit const FrontKernels avx512_front_kernels = {"avx512", FrontTiles<Avx512>::factor_panel,
                                                     FrontTiles<Avx512>::subtract_square};

}  // namespace hapticd
