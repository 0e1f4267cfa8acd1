#include "physics/compliance/front_tiles.h"

namespace hapticd {

namespace {

struct Generic {
  using Vector = double __attribute__((vector_size(16)));
  static constexpr int lanes = 2;
};

}  // namespace

constinit const FrontKernels generic_front_kernels = {"generic", FrontTiles<Generic>::factor_panel,
                                                      FrontTiles<Generic>::subtract_square};

}  // namespace hapticd
