// The daemon's malloc: glibc's own, plus a count of who calls it within the haptic tick (allocation_count.h).
//
// By symbol interposition, so operator new, Eigen and every C library are caught. Linked into hapticd alone.
#include "haptic/allocation_count.h"

#include <cstdlib>  // defines __GLIBC__

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && defined(__GLIBC__)
#include <unistd.h>

#include <cerrno>
#include <cstddef>

namespace {

[[maybe_unused]] const bool counting = [] {
  hapticd::allocation_count::available.store(true);
  return true;
}();

}  // namespace

extern "C" {

void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* p, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);

void* malloc(std::size_t size) {
  hapticd::allocation_count::note();
  return __libc_malloc(size);
}

void* calloc(std::size_t count, std::size_t size) {
  hapticd::allocation_count::note();
  return __libc_calloc(count, size);
}

void* realloc(void* p, std::size_t size) {
  hapticd::allocation_count::note();
  return __libc_realloc(p, size);
}

void* memalign(std::size_t alignment, std::size_t size) {
  hapticd::allocation_count::note();
  return __libc_memalign(alignment, size);
}

void* aligned_alloc(std::size_t alignment, std::size_t size) { return memalign(alignment, size); }

int posix_memalign(void** p, std::size_t alignment, std::size_t size) {
  *p = memalign(alignment, size);
  return *p ? 0 : ENOMEM;
}

void* valloc(std::size_t size) { return memalign(static_cast<std::size_t>(sysconf(_SC_PAGESIZE)), size); }

}  // extern "C"
#endif
