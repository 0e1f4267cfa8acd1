// The columns of a factor that come before the zone, with the solves that use them alone.
//
//   L = [L_rr 0; L_zr L_zz]:   forward  x_r ← L_rr⁻¹ x_r,  x_z ← x_z − L_zr x_r
//                              backward x_r ← L_rr⁻ᵀ (x_r − L_zrᵀ x_z)
//
// so that a solve may use another corner than L_zz between its two halves. Fronts are the factor's own, and
// so is their memory; one that reaches into the zone is cut at the zone's first column. A solve is bound by
// memory traffic, so it can go with a rounded copy (quantised_factor.h). `forward_sparse` visits only the
// panels that few nonzero rows reach, on many right-hand sides at once. Shapes: vectors and columns of
// 3·nodes in the order's places. Units: L Lᵀ [N/m]. Solves of one vector allocate nothing once one was done;
// several threads need several objects.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "physics/compliance/factor/multifrontal_factor.h"
#include "physics/compliance/zone/quantised_factor.h"

namespace hapticd {

enum class PanelPrecision : std::uint8_t { full, rounded };

class LeadingColumns {
 public:
  LeadingColumns() = default;
  // Columns before `rest_dofs`; with a rounded copy beside them or not, in memory of an earlier one. The
  // factor is used up.
  LeadingColumns(MultifrontalFactor&& factor, int rest_dofs, bool quantised_copy,
                 PageMemory quantised_memory = {});

  // For the next: the panels are nothing afterwards.
  PageMemory take_values() noexcept { return std::move(value_); }
  PageMemory take_quantised_memory() noexcept { return rounded_.take_memory(); }

  int rest_dofs() const noexcept { return rest_dofs_; }
  bool has_quantised_copy() const noexcept { return !rounded_.empty(); }

  void forward(VecX& x, PanelPrecision precision) noexcept;
  void backward(VecX& x, PanelPrecision precision) noexcept;

  // The same of the last panel's columns alone: of an x that is zero before them, and for what is asked of
  // them.
  int last_first() const noexcept { return panel_.empty() ? rest_dofs_ : panel_.back().first; }
  void forward_last(VecX& x, PanelPrecision precision) noexcept;
  void backward_last(VecX& x, PanelPrecision precision) noexcept;

  // Forward on columns whose nonzero rest rows are among `nonzero`. `reached` gets the rest rows that may now
  // be nonzero, ascending.
  void forward_sparse(Eigen::Ref<MatX> X, std::span<const int> nonzero, std::vector<int>& reached);

  std::size_t memory_bytes() const noexcept;

 private:
  bool solves_rounded(PanelPrecision precision) const noexcept {
    return precision == PanelPrecision::rounded && has_quantised_copy();
  }
  void forward_full(const LeadingPanel& panel, VecX& x) noexcept;
  void backward_full(const LeadingPanel& panel, VecX& x) noexcept;

  int rest_dofs_ = 0;
  std::vector<LeadingPanel> panel_;
  std::vector<int> panel_of_;  // per rest column
  std::vector<int> row_;
  PageMemory value_;
  QuantisedFactor rounded_;
  VecX gathered_;
  std::vector<std::uint8_t> touched_;  // per panel
  MatX below_;
};

}  // namespace hapticd
