// Numbers in memory of their own, on huge pages where the system grants them: a factor of some megabytes is
// walked through in columns, and ordinary pages cost a look-up for every other column.
//
// Grows only, loses its content when it grows, and is zero then. Throws std::bad_alloc.
#pragma once

#include <sys/mman.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>

namespace hapticd {

class PageMemory {
 public:
  double* data() const noexcept { return data_.get(); }
  std::size_t size() const noexcept { return size_; }

  void reserve(std::size_t numbers) {
    if (numbers <= size_) return;
    constexpr std::size_t page = std::size_t{2} << 20;
    const std::size_t bytes = (numbers * sizeof(double) + page - 1) / page * page;
    data_.reset();
    size_ = 0;
    data_.reset(static_cast<double*>(std::aligned_alloc(page, bytes)));
    if (!data_) throw std::bad_alloc();
    madvise(data_.get(), bytes, MADV_HUGEPAGE);  // refused: ordinary pages do
    size_ = bytes / sizeof(double);
    std::fill_n(data_.get(), size_, 0.0);
  }

 private:
  struct Free {
    void operator()(double* p) const noexcept { std::free(p); }
  };
  std::unique_ptr<double, Free> data_;
  std::size_t size_ = 0;
};

}  // namespace hapticd
