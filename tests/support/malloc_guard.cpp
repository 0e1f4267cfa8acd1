#include "tests/support/malloc_guard.h"

#include <cstdlib>  // defines __GLIBC__

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && defined(__GLIBC__)
#define HAPTICD_MALLOC_GUARD 1
#endif

#ifdef HAPTICD_MALLOC_GUARD
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#endif

namespace hapticd {
namespace {

thread_local long allocations = 0;
thread_local long frees = 0;
thread_local int forbidding = 0;

#ifdef HAPTICD_MALLOC_GUARD
void count_allocation() noexcept {
  ++allocations;
  if (forbidding == 0) return;
  forbidding = 0;
  constexpr char message[] = "MallocGuard: allocation where it is forbidden\n";
  [[maybe_unused]] const auto written = write(STDERR_FILENO, message, sizeof message - 1);
  std::abort();
}
#endif

}  // namespace

MallocGuard::MallocGuard(Mode mode) noexcept
    : allocations_(hapticd::allocations), frees_(hapticd::frees), forbids_(mode == Mode::forbid) {
  forbidding += forbids_;
}

MallocGuard::~MallocGuard() { forbidding -= forbids_; }

long MallocGuard::allocations() const noexcept { return hapticd::allocations - allocations_; }
long MallocGuard::frees() const noexcept { return hapticd::frees - frees_; }

bool MallocGuard::available() noexcept {
#ifdef HAPTICD_MALLOC_GUARD
  return true;
#else
  return false;
#endif
}

}  // namespace hapticd

#ifdef HAPTICD_MALLOC_GUARD
extern "C" {

void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* p, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
void __libc_free(void* p);

void* malloc(std::size_t size) {
  hapticd::count_allocation();
  return __libc_malloc(size);
}

void* calloc(std::size_t count, std::size_t size) {
  hapticd::count_allocation();
  return __libc_calloc(count, size);
}

void* realloc(void* p, std::size_t size) {
  hapticd::count_allocation();
  return __libc_realloc(p, size);
}

void* memalign(std::size_t alignment, std::size_t size) {
  hapticd::count_allocation();
  return __libc_memalign(alignment, size);
}

void* aligned_alloc(std::size_t alignment, std::size_t size) { return memalign(alignment, size); }

int posix_memalign(void** p, std::size_t alignment, std::size_t size) {
  *p = memalign(alignment, size);
  return *p ? 0 : ENOMEM;
}

void* valloc(std::size_t size) { return memalign(static_cast<std::size_t>(sysconf(_SC_PAGESIZE)), size); }

void free(void* p) {
  if (p) ++hapticd::frees;
  __libc_free(p);
}

}  // extern "C"
#endif
