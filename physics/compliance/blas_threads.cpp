#include "physics/compliance/blas_threads.h"

#ifdef HAPTICD_OPENBLAS
extern "C" {
void openblas_set_num_threads(int threads);
int openblas_get_num_threads();
int blas_thread_shutdown_() __attribute__((weak));  // its own, before a fork; not in every variant
}
#endif

namespace hapticd {

void use_one_blas_thread() noexcept {
#ifdef HAPTICD_OPENBLAS
  openblas_set_num_threads(1);
  if (blas_thread_shutdown_) blas_thread_shutdown_();
#endif
}

int blas_threads() noexcept {
#ifdef HAPTICD_OPENBLAS
  return openblas_get_num_threads();
#else
  return 1;
#endif
}

}  // namespace hapticd
