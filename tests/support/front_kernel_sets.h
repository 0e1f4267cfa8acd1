// The kernels of fronts that this processor runs, the best of them last.
#pragma once

#include <string_view>
#include <vector>

#include "physics/compliance/factor/front_kernels.h"

namespace hapticd {

inline std::vector<const FrontKernels*> front_kernel_sets() {
  std::vector<const FrontKernels*> sets = {&generic_front_kernels};
#ifdef __x86_64__
  const std::string_view best = front_kernels().name;
  if (best != "generic") sets.push_back(&avx2_front_kernels);
  if (best == "avx512") sets.push_back(&avx512_front_kernels);
#endif
  return sets;
}

}  // namespace hapticd
