// A box of tissue with method `zone`, held against a dense inverse.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <random>
#include <vector>

#include "tests/physics/compliance/oracle.h"

namespace hapticd::zone_bench {

using oracle::box;
using oracle::deformed;
using oracle::h;
using oracle::Where;

inline const Vec3 tip(4.5e-3, 4e-3, 6e-3);

inline std::unique_ptr<ReferenceCompliance> zone_method(const TissueModel& model,
                                                        const std::vector<int>& zone,
                                                        const ComplianceOptions& options = {}) {
  auto compliance = make_zone_compliance(model, h, options);
  compliance->move_zone(zone);
  return compliance;
}

inline void remove(const TissueModel& model, TissueState& state, Compliance& compliance,
                   const std::vector<int>& tets) {
  remove_tets(model, state, tets);
  compliance.remove(state, tets);
}

struct Errors {
  double apply, patch;
};

inline Errors errors_of(const TissueModel& model, const TissueState& state, Compliance& compliance,
                        const std::vector<int>& patch) {
  const MatX C = oracle::inverse(model, state);
  return {oracle::apply_error(compliance, C), oracle::patch_error(compliance, C, patch)};
}

inline void expect_exact(const TissueModel& model, const TissueState& state, Compliance& compliance,
                         const std::vector<int>& patch, double tolerance = 1e-10) {
  const Errors errors = errors_of(model, state, compliance, patch);
  EXPECT_LT(errors.apply, tolerance);
  EXPECT_LT(errors.patch, tolerance);
  EXPECT_EQ(compliance.report().health, ComplianceHealth::good);
  EXPECT_LT(compliance.report().residual, 1e-10);
}

inline std::vector<int> tets_where(const TissueModel& model, const std::vector<int>& zone, Where where) {
  std::vector<int> tets;
  for (int t = 0; t < model.tet_count(); ++t)
    if (oracle::where(model, zone, t) == where) tets.push_back(t);
  std::mt19937 random(17);
  std::shuffle(tets.begin(), tets.end(), random);
  return tets;
}

}  // namespace hapticd::zone_bench
