#include "physics/compliance/residual.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hapticd {

namespace {

template <class InSystem, class Product>
ResidualSample sample_of(Compliance& compliance, int nodes, const InSystem& in_system, const Product& A) {
  ResidualSample sample;
  VecX b = VecX::Zero(3 * nodes);
  for (int n = 0; n < nodes; ++n) {
    if (!in_system(n)) continue;
    for (int r = 0; r < 3; ++r) b[3 * n + r] = std::sin(1.0 + 2.7 * n + 1.3 * r);
  }
  const double load = b.norm();
  if (!(load > 0)) return sample;
  VecX y(b.size());
  compliance.apply(b, y);
  b -= A(y);
  sample.residual = b.norm() / load;
  sample.answer = y.norm();
  sample.r = std::move(b);
  return sample;
}

}  // namespace

ResidualSample sample_residual(Compliance& compliance, const SystemMatrix& A) {
  return sample_of(
      compliance, A.node_count(), [&](int n) { return A.in_system(n); },
      [&](const VecX& y) { return A.multiply(y); });
}

ResidualSample sample_residual(Compliance& compliance, const TissueModel& model, const TissueState& state,
                               double h) {
  return sample_of(
      compliance, model.node_count(),
      [&](int n) { return !model.fixed[n] && state.live_tets_of_node[n] > 0; },
      [&](const VecX& y) { return multiply_system_matrix(model, state, h, y); });
}

SampledError error_of(Compliance& compliance, ResidualSample sample) {
  SampledError sampled;
  if (sample.r.size() == 0) return sampled;
  compliance.apply(sample.r, sample.r);
  sampled.residual = sample.residual;
  sampled.error = sample.r.norm() / sample.answer;
  if (!std::isfinite(sampled.residual)) sampled.residual = std::numeric_limits<double>::infinity();
  if (!std::isfinite(sampled.error)) sampled.error = std::numeric_limits<double>::infinity();
  return sampled;
}

SampledError sample_error(Compliance& compliance, const SystemMatrix& A) {
  return error_of(compliance, sample_residual(compliance, A));
}

ComplianceHealth health_of(const SampledError& sampled, const ComplianceOptions& options) noexcept {
  const double worst = std::max(sampled.residual, sampled.error);
  if (!(worst <= options.usable_error)) return ComplianceHealth::degraded;
  return worst <= options.good_error ? ComplianceHealth::good : ComplianceHealth::new_reference_wanted;
}

}  // namespace hapticd
