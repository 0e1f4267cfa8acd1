#include "physics/compliance/residual.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hapticd {

ResidualSample sample_residual(Compliance& compliance, const SystemMatrix& A) {
  ResidualSample sample;
  VecX b = VecX::Zero(3 * A.node_count());
  for (int n = 0; n < A.node_count(); ++n) {
    if (!A.in_system(n)) continue;
    for (int r = 0; r < 3; ++r) b[3 * n + r] = std::sin(1.0 + 2.7 * n + 1.3 * r);
  }
  const double load = b.norm();
  if (!(load > 0)) return sample;
  VecX y(b.size());
  compliance.apply(b, y);
  b -= A.multiply(y);
  sample.residual = b.norm() / load;
  sample.answer = y.norm();
  sample.r = std::move(b);
  return sample;
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
  return worst <= options.good_error ? ComplianceHealth::good : ComplianceHealth::rebase_wanted;
}

}  // namespace hapticd
