// Numbers in memory of their own, on huge pages where the system grants them: a factor of some megabytes is
// walked through in columns, and ordinary pages cost a look-up for every other column.
//
// Huge pages are asked for before the first touch, and only then. Of memory that has ordinary pages already
// (all of the heap, where the process locks its memory) the kernel's khugepaged would make huge ones later,
// at a moment of its own, and who touches them then waits: the haptic thread among others that share the
// heap.
//
// Grows only, loses its content when it grows, and is zero then. Throws std::bad_alloc.
#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>

namespace hapticd {

class PageMemory {
 public:
  double* data() const noexcept { return data_.get(); }
  std::size_t size() const noexcept { return size_; }

  void reserve(std::size_t numbers) {
    if (data_ && numbers <= size_) return;
    constexpr std::size_t page = std::size_t{2} << 20;  // a huge one
    const std::size_t bytes = (numbers * sizeof(double) + page - 1) / page * page;
    data_.reset();
    size_ = 0;
    data_ = map(bytes, page);
    madvise(data_.get(), bytes, MADV_HUGEPAGE);  // refused: ordinary pages do
    if (mprotect(data_.get(), bytes, PROT_READ | PROT_WRITE) != 0) throw std::bad_alloc();
    size_ = bytes / sizeof(double);
    // The kernel clears a page when it is touched.
    constexpr std::size_t smallest_page = 4096 / sizeof(double);
    for (std::size_t i = 0; i < size_; i += smallest_page) *const_cast<volatile double*>(data_.get() + i) = 0;
    madvise(data_.get(), bytes, MADV_NOHUGEPAGE);
  }

 private:
  struct Unmap {
    void* begin;
    std::size_t bytes;
    void operator()(double*) const noexcept { munmap(begin, bytes); }
  };
  using Mapping = std::unique_ptr<double, Unmap>;

  // Not to be touched yet, so that locking all memory does not fill it with ordinary pages.
  static Mapping map(std::size_t bytes, std::size_t alignment) {
    void* const begin = mmap(nullptr, bytes + alignment, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (begin == MAP_FAILED) throw std::bad_alloc();
    const auto address = reinterpret_cast<std::uintptr_t>(begin);
    const std::size_t ahead = (alignment - address % alignment) % alignment;
    return Mapping(reinterpret_cast<double*>(address + ahead), Unmap{begin, bytes + alignment});
  }

  Mapping data_;
  std::size_t size_ = 0;
};

}  // namespace hapticd
