// Memory for so many numbers, aligned to 64 bytes as the front kernels want it, and zero.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace hapticd {

class AlignedNumbers {
 public:
  explicit AlignedNumbers(std::size_t count) : data_(count + numbers_a_line) {}

  double* data() noexcept { return data_.data() + ahead(); }
  const double* data() const noexcept { return data_.data() + ahead(); }

 private:
  static constexpr std::size_t numbers_a_line = 64 / sizeof(double);

  // Computed anew, for a copy lies elsewhere.
  std::size_t ahead() const noexcept {
    const std::size_t address = reinterpret_cast<std::uintptr_t>(data_.data()) / sizeof(double);
    return (numbers_a_line - address % numbers_a_line) % numbers_a_line;
  }

  std::vector<double> data_;
};

}  // namespace hapticd
