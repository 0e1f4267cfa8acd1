// Counts what the current thread allocates and frees while a guard lives: malloc's whole family, by
// symbol interposition, so operator new (which calls it), Eigen and C libraries are all caught.
//
// Guards nest; each counts from its own construction. `forbid` ends the process at the first
// allocation, where a debugger shows who asked.
// Not compiled under AddressSanitizer or ThreadSanitizer, which own malloc: `available()` is false there,
// nothing is counted, and a test that needs counts skips itself.
// Thread safety: counters are thread-local.
#pragma once

namespace hapticd {

class MallocGuard {
 public:
  enum class Mode { count, forbid };

  explicit MallocGuard(Mode mode = Mode::count) noexcept;
  ~MallocGuard();
  MallocGuard(const MallocGuard&) = delete;
  MallocGuard& operator=(const MallocGuard&) = delete;

  long allocations() const noexcept;
  long frees() const noexcept;

  static bool available() noexcept;

 private:
  long allocations_;
  long frees_;
  bool forbids_;
};

}  // namespace hapticd
