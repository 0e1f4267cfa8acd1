// A rounded copy of the columns before the zone, that solves in single precision: a quarter of the bytes.
//
//   L ≈ T + Q diag(u),   u_j = max_i |L_ij| / 32767,   |L_ij − u_j Q_ij| ≤ u_j / 2
//
// T: triangles of eight columns each, in single precision; Q: what is below them, 16-bit integers. About 1e-4
// of a solution is lost (README.md), the same in both halves: they stay each other's transpose. How it lies
// in memory: quantised_kernels.h. Shapes: vectors of 3·nodes in the order's places. Units: L Lᵀ [N/m].
// Guarantee: solves are wait-free and allocate nothing; several threads need several objects.
#pragma once

#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "physics/compliance/factor/page_memory.h"
#include "physics/compliance/zone/leading_panel.h"
#include "physics/compliance/zone/quantised_kernels.h"
#include "physics/types.h"

namespace hapticd {

class QuantisedFactor {
 public:
  QuantisedFactor() = default;
  // Panels must stay where they are. Other kernels than the best are for tests.
  // `memory`: of an earlier copy, to be used again.
  QuantisedFactor(std::span<const LeadingPanel> panels, const int* rows, const double* values,
                  PageMemory memory = {}, const QuantisedKernels& kernels = quantised_kernels());
  PageMemory take_memory() noexcept { return std::move(memory_); }

  bool empty() const noexcept { return panels_.empty(); }
  std::size_t memory_bytes() const noexcept { return memory_.size() * sizeof(double); }

  // The two halves of a solve, as LeadingColumns'.
  void forward(VecX& x) noexcept;
  void backward(VecX& x) noexcept;
  void forward_last(VecX& x) noexcept;
  void backward_last(VecX& x) noexcept;

 private:
  // Rows below a panel that follow one another.
  struct Run {
    int row;
    int count;
  };

  void find_runs(const int* rows);
  std::size_t first_run(std::size_t panel) const noexcept { return panel > 0 ? runs_end_[panel - 1] : 0; }
  const std::byte* forward(std::size_t panel, const std::byte* at, VecX& x) noexcept;
  const std::byte* backward(std::size_t panel, const std::byte* end, VecX& x) noexcept;

  std::span<const LeadingPanel> panels_;
  std::vector<Run> runs_;
  std::vector<std::size_t> runs_end_;  // per panel
  const QuantisedKernels* kernels_ = nullptr;
  PageMemory memory_;
  const std::byte* last_ = nullptr;  // panel
  const std::byte* end_ = nullptr;
  std::vector<float> own_;  // scratch: what a panel's rows hold
};

}  // namespace hapticd
