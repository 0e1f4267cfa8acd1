#include "physics/compliance/zone/rounded_kernels.h"

namespace hapticd {

const RoundedKernels& rounded_kernels() noexcept {
#ifdef HAPTICD_X86_KERNELS
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
      __builtin_cpu_supports("avx512bw"))
    return avx512_rounded_kernels;
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return avx2_rounded_kernels;
#endif
  return generic_rounded_kernels;
}

}  // namespace hapticd
