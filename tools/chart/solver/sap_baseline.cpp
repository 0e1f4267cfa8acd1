#include "tools/chart/solver/sap_baseline.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

#include "physics/contact/solver/coulomb.h"

namespace hapticd {
namespace {

constexpr int most_trials = 60;
constexpr double longest_step = 1.5;  // of Newton's, as Drake's
constexpr double exact_slope = 1e-9;  // of the slope at the step's begin

// G = B Bᵀ of all contacts; a column lives in the rows of one contact.
struct Columns {
  std::vector<Eigen::Index> row;  // the contact's first
  std::vector<Vec3> value;

  void add(Eigen::Index first, const Vec3& v) {
    row.push_back(first);
    value.push_back(v);
  }
  Eigen::Index size() const { return static_cast<Eigen::Index>(row.size()); }
};

class Sap {
 public:
  Sap(const MatX& W, const VecX& q, std::span<const double> mu, const SapOptions& options)
      : W_(W), q_(q), mu_(mu), width_(mu.empty() ? 1 : 3), R_(q.size() / width_) {
    for (Eigen::Index i = 0; i < R_.size(); ++i)
      R_[i] = options.relative_diagonal * W.diagonal().segment(width_ * i, width_).mean();
  }

  VecX gamma(const VecX& delta) const {
    VecX out(delta.size());
    for (Eigen::Index i = 0; i < R_.size(); ++i) {
      if (width_ == 1)
        out[i] = std::max(0.0, -delta[i] / R_[i]);
      else
        out.segment<3>(3 * i) = project_on_cone(-delta.segment<3>(3 * i) / R_[i], mu_[i]);
    }
    return out;
  }

  Columns root_of_slope(const VecX& delta) const {
    Columns B;
    for (Eigen::Index i = 0; i < R_.size(); ++i) {
      const double by = 1 / std::sqrt(R_[i]);
      if (width_ == 1) {
        if (delta[i] < 0) B.add(i, Vec3(by, 0, 0));
        continue;
      }
      const Vec3 y = -delta.segment<3>(3 * i) / R_[i], p = project_on_cone(y, mu_[i]);
      if (!(p[0] > 0)) continue;
      const double mu = mu_[i], along = y.tail<2>().norm();
      if (along <= mu * y[0]) {
        for (int c = 0; c < 3; ++c) B.add(3 * i, by * Vec3::Unit(c));
        continue;
      }
      // On the cone's side: along the line that y falls on, and turning about the axis.
      const Eigen::Vector2d t = y.tail<2>() / along;
      B.add(3 * i, by * Vec3(1, mu * t[0], mu * t[1]) / std::sqrt(1 + mu * mu));
      if (mu > 0) B.add(3 * i, by * std::sqrt(mu * p[0] / along) * Vec3(0, -t[1], t[0]));
    }
    return B;
  }

  // Newton's step (I + G W)⁻¹ (−r); false where the factor fails.
  bool step(const Columns& B, const VecX& r, VecX& out) const {
    const Eigen::Index k = B.size();
    MatX WB(q_.size(), k);
    for (Eigen::Index j = 0; j < k; ++j)
      WB.col(j).noalias() = W_.middleCols(B.row[j], width_) * B.value[j].head(width_);
    MatX S(k, k);
    for (Eigen::Index j = 0; j < k; ++j)
      for (Eigen::Index i = 0; i < k; ++i)
        S(i, j) = B.value[i].head(width_).dot(WB.col(j).segment(B.row[i], width_)) + (i == j);
    const Eigen::LLT<MatX> factor(S);
    if (factor.info() != Eigen::Success) return false;
    const VecX s = factor.solve(WB.transpose() * r);
    out = -r;
    for (Eigen::Index j = 0; j < k; ++j) out.segment(B.row[j], width_) += s[j] * B.value[j].head(width_);
    return true;
  }

 private:
  const MatX& W_;
  const VecX& q_;
  std::span<const double> mu_;
  Eigen::Index width_;
  VecX R_;
};

// Zero of a slope that rises, from slope(0) < 0: by regula falsi with the kept end halved (Illinois).
template <typename Slope>
double exact_line_search(double at_zero, const Slope& slope) {
  const double enough = exact_slope * std::abs(at_zero);
  double f = slope(1.0);
  if (std::abs(f) <= enough) return 1;
  double a = 0, fa = at_zero, b = 1, fb = f;
  if (f < 0) {
    a = 1, fa = f, b = longest_step, fb = slope(b);
    if (fb <= 0) return b;
  }
  int side = 0;
  double t = b;
  for (int k = 0; k < most_trials; ++k) {
    t = (a * fb - b * fa) / (fb - fa);
    f = slope(t);
    if (std::abs(f) <= enough || b - a <= 1e-14) break;
    if (f > 0) {
      b = t, fb = f;
      if (side == 1) fa /= 2;
      side = 1;
    } else {
      a = t, fa = f;
      if (side == -1) fb /= 2;
      side = -1;
    }
  }
  return t;
}

}  // namespace

SapResult solve_sap(const MatX& W, const VecX& q, std::span<const double> mu, VecX& lambda,
                    const SapOptions& options) {
  const Sap sap(W, q, mu, options);
  SapResult result;
  VecX z = lambda, Wz = W * z, delta = Wz + q, gamma = sap.gamma(delta), dz;
  while (true) {
    const VecX r = z - gamma, Wr = W * r;
    const double size = std::sqrt(std::max({0.0, z.dot(Wz), gamma.dot(W * gamma)}));
    result.solved = std::sqrt(std::max(0.0, r.dot(Wr))) <= options.tolerance * size;
    if (result.solved || result.newton == options.max_newton || options.deadline.passed()) break;
    if (!sap.step(sap.root_of_slope(delta), r, dz)) break;
    ++result.newton;
    const VecX Wdz = W * dz;
    const double at_zero = Wdz.dot(r);
    if (!(at_zero < 0)) break;  // round-off
    const double alpha = exact_line_search(
        at_zero, [&](double t) { return Wdz.dot(z + t * dz - sap.gamma(delta + t * Wdz)); });
    z += alpha * dz;
    Wz = W * z;
    delta = Wz + q;
    gamma = sap.gamma(delta);
  }
  lambda = gamma;
  return result;
}

}  // namespace hapticd
