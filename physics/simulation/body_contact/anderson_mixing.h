// Where a fixed-point iteration z → g(z) looks next: Anderson's mixing of its last two steps.
//
//   f_k = g(z_k) − z_k,  γ = argmin ‖f_k − ΔF γ‖,  z_k+1 = g(z_k) − ΔG γ        (ΔF, ΔG: last differences)
//
// What it settles at is a fixed point of g. z and g: one size, one unit. The history begins again with
// z_k+1 = g(z_k) where f grew or the size changed, and where z_k+1 would be more than 5 ‖f_k‖ from g(z_k).
// Errors: none. Source: Anderson 1965; Walker and Ni 2011.
#pragma once

#include "physics/types.h"

namespace hapticd {

class AndersonMixing {
 public:
  // z led to g.
  VecX next(const VecX& z, const VecX& g);

 private:
  static constexpr int depth = 2;

  MatX dF_, dG_;
  VecX f_, g_;
  int used_ = 0;  // columns
};

}  // namespace hapticd
