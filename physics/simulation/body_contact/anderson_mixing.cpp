#include "physics/simulation/body_contact/anderson_mixing.h"

#include <Eigen/QR>

namespace hapticd {
namespace {

constexpr double longest = 5;  // ‖z_k+1 − g(z_k)‖ / ‖f_k‖

}  // namespace

VecX AndersonMixing::next(const VecX& z, const VecX& g) {
  const VecX f = g - z;
  if (f.size() == f_.size() && f.norm() < f_.norm()) {
    if (used_ == depth) {
      dF_.col(0) = dF_.col(1);
      dG_.col(0) = dG_.col(1);
      used_ = 1;
    }
    dF_.col(used_) = f - f_;
    dG_.col(used_) = g - g_;
    ++used_;
  } else {
    used_ = 0;
    dF_.resize(f.size(), depth);
    dG_.resize(f.size(), depth);
  }
  f_ = f;
  g_ = g;
  if (used_ == 0) return g;
  const VecX gamma = dF_.leftCols(used_).colPivHouseholderQr().solve(f);
  const VecX step = dG_.leftCols(used_) * gamma;
  if (step.norm() <= longest * f.norm()) return g - step;
  used_ = 0;
  return g;
}

}  // namespace hapticd
