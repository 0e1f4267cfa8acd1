#include "physics/compliance/zone/quantised_kernels.h"

namespace hapticd {

const QuantisedKernels& quantised_kernels() noexcept {
#ifdef HAPTICD_X86_KERNELS
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
      __builtin_cpu_supports("avx512bw"))
    return avx512_quantised_kernels;
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return avx2_quantised_kernels;
#endif
  return generic_quantised_kernels;
}

}  // namespace hapticd
