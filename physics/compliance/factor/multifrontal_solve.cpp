#include "physics/compliance/factor/multifrontal_factor.h"
#include "physics/compliance/factor/panel_kernels.h"

namespace hapticd {

// Forward, children before parents: x₁ ← L11⁻¹ x₁, x₂ ← x₂ − L21 x₁; backward, parents before children:
// x₁ ← L11⁻ᵀ (x₁ − L21ᵀ x₂).
void MultifrontalFactor::solve() noexcept {
  double* t = gathered_.data();
  for (const FrontPlan::Front& front : plan_.fronts) {
    const double* panel = values_.data() + front.panel;
    const int stride = static_cast<int>(front.stride);
    const int count = front.size - front.width;
    double* own = x_.data() + front.first;
    panels::solve_lower(panel, stride, front.width, own);
    std::fill_n(t, count, 0.0);
    panels::add_product(panel + front.width, stride, count, front.width, own, t);
    const int* row = plan_.below.data() + front.below;
    for (int i = 0; i < count; ++i) x_[row[i]] -= t[i];
  }
  for (auto front = plan_.fronts.rbegin(); front != plan_.fronts.rend(); ++front) {
    const double* panel = values_.data() + front->panel;
    const int stride = static_cast<int>(front->stride);
    const int count = front->size - front->width;
    double* own = x_.data() + front->first;
    const int* row = plan_.below.data() + front->below;
    for (int i = 0; i < count; ++i) t[i] = x_[row[i]];
    panels::subtract_transposed(panel + front->width, stride, count, front->width, t, own);
    panels::solve_upper(panel, stride, front->width, own);
  }
}

}  // namespace hapticd
