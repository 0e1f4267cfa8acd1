#include "physics/compliance/factor/front_kernels.h"

namespace hapticd {

const FrontKernels& front_kernels() noexcept {
#ifdef HAPTICD_X86_KERNELS
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl")) return avx512_front_kernels;
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) return avx2_front_kernels;
#endif
  return generic_front_kernels;
}

}  // namespace hapticd
