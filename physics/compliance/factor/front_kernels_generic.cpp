#include "physics/compliance/factor/front_tiles.h"

namespace hapticd {

namespace {

struct Generic {
  using Vector = double __attribute__((vector_size(16)));
  static constexpr int lanes = 2;
  static unsigned spread(unsigned mask) noexcept { return mask; }
  static void add(unsigned mask, const double* from, double* to) noexcept {
    for (; mask != 0; mask &= mask - 1) to[__builtin_ctz(mask)] += *from++;
  }
};

}  // namespace

constinit const FrontKernels generic_front_kernels = {"generic",
                                                      FrontTiles<Generic>::factor_panel,
                                                      FrontTiles<Generic>::make_contribution,
                                                      FrontTiles<Generic>::add_child,
                                                      FrontTiles<Generic>::solve_rows,
                                                      FrontTiles<Generic>::multiply_rows};

}  // namespace hapticd
