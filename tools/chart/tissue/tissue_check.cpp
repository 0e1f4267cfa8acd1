#include "tools/chart/tissue/tissue_check.h"

#include <cmath>

namespace hapticd {

void TissueFindings::check(const std::string& name, double reference, double value, double tolerance,
                           const std::string& source) {
  const double error = reference != 0 ? std::abs(value - reference) / std::abs(reference) : std::abs(value);
  checks.push_back({name, reference, value, error, tolerance, source, error <= tolerance});
}

void TissueFindings::converges(const TissueSeries& of, double tolerance, const std::string& source) {
  series.push_back(of);
  check(of.name + ": order of convergence", of.expected_order, order_of(of), tolerance, source);
}

double order_of(const TissueSeries& s) {
  const std::size_t n = s.size.size();
  return std::log(s.error[n - 2] / s.error[n - 1]) / std::log(s.size[n - 2] / s.size[n - 1]);
}

double extrapolated(double coarse, double fine, double ratio, double order) {
  return fine + (fine - coarse) / (std::pow(ratio, order) - 1);
}

const std::vector<TissueCheckGroup>& tissue_check_groups() {
  static const std::vector<TissueCheckGroup> groups = {{"patch", check_patch},
                                                       {"invariance", check_invariance},
                                                       {"derivatives", check_derivatives},
                                                       {"cantilever", check_cantilever},
                                                       {"elastica", check_elastica},
                                                       {"torsion", check_torsion},
                                                       {"frequencies", check_frequencies},
                                                       {"manufactured", check_manufactured},
                                                       {"le10", check_le10},
                                                       {"boussinesq", check_boussinesq},
                                                       {"hertz", check_hertz},
                                                       {"motion", check_motion},
                                                       {"calculix", check_calculix},
                                                       {"locking", check_locking}};
  return groups;
}

}  // namespace hapticd
