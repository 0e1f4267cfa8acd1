// A dense Cholesky factor that is renewed in place: S = L Lᵀ, by the kernels of a front.
//
// The whole of S is one panel (front_kernels.h), in memory of its own: columns are aligned, and far enough
// apart that a row does not fall into few lines of the cache. Shapes: S and L size square, lower triangle;
// above L's diagonal are numbers of no meaning. Units: as S's. Guarantee: `factor` allocates nothing.
#pragma once

#include <algorithm>
#include <vector>

#include "physics/compliance/factor/front_kernels.h"
#include "physics/compliance/factor/page_memory.h"
#include "physics/types.h"

namespace hapticd {

class DenseFactor {
 public:
  using View = Eigen::Map<MatX, 0, Eigen::OuterStride<>>;

  // Others than the processor's best are for tests.
  explicit DenseFactor(const FrontKernels& kernels = front_kernels()) : kernels_(&kernels) {}

  // Up to this size `resize` then allocates nothing.
  void reserve(int size) {
    memory_.reserve(static_cast<std::size_t>(stride_of(size)) * size);
    reciprocal_.reserve(size);
  }

  void resize(int size) {
    size_ = size;
    stride_ = stride_of(size);
    memory_.reserve(static_cast<std::size_t>(stride_) * size);
    reciprocal_.resize(size);
  }

  // To be filled with S; then L.
  View matrix() noexcept { return {memory_.data(), size_, size_, Eigen::OuterStride<>(stride_)}; }

  // Returns false if S is not positive definite.
  [[nodiscard]] bool factor() noexcept {
    const int height = (size_ + row_multiple - 1) / row_multiple * row_multiple;
    for (int j = 0; j < size_; ++j) std::fill_n(memory_.data() + j * stride_ + size_, height - size_, 0.0);
    FrontAhead nothing;
    return kernels_->factor_panel(memory_.data(), stride_, height, size_, reciprocal_.data(), nothing);
  }

 private:
  static int stride_of(int size) noexcept {
    const int height = (size + row_multiple - 1) / row_multiple * row_multiple;
    return height / row_multiple % 2 == 0 ? height + row_multiple : height;
  }

  const FrontKernels* kernels_;
  int size_ = 0;
  std::ptrdiff_t stride_ = 0;
  PageMemory memory_;
  std::vector<double> reciprocal_;  // of the diagonal of L
};

}  // namespace hapticd
