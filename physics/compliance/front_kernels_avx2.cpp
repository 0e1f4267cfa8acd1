#include "physics/compliance/front_tiles.h"

namespace hapticd {

namespace {

struct Avx2 {
  using Vector = double __attribute__((vector_size(32)));
  static constexpr int lanes = 4;
};

}  // namespace

constinit const FrontKernels avx2_front_kernels = {"avx2", FrontTiles<Avx2>::factor_panel,
                                                   FrontTiles<Avx2>::subtract_square};

}  // namespace hapticd
