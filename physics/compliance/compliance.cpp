#include "physics/compliance/compliance.h"

#include <stdexcept>

#include "physics/compliance/near_compliance.h"
#include "physics/compliance/reference/warped_compliance.h"
#include "physics/compliance/reference_compliance.h"

namespace hapticd {

void Compliance::reshape(const TissueState& after, std::span<const int> tets) {
  static_cast<void>(after);
  static_cast<void>(tets);
  throw std::runtime_error("this compliance method does not follow cuts");
}

Solved ReferenceCompliance::start_solve(const Eigen::Ref<const VecX>& b, Eigen::Ref<VecX> y) {
  apply(b, y);
  return Solved::whole;
}

void ReferenceCompliance::finish_solve(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) {
  static_cast<void>(f);
  static_cast<void>(y);
  throw std::runtime_error("every solve of this compliance is whole");
}

double ReferenceCompliance::disagreement(const TissueState& state, const VecX& y) {
  static_cast<void>(state);
  static_cast<void>(y);
  return 0;
}

namespace {

std::unique_ptr<ReferenceCompliance> with_reference(ComplianceMethod method, const TissueModel& model,
                                                    double h, const ComplianceOptions& options) {
  switch (method) {
    case ComplianceMethod::zone:
      return make_zone_compliance(model, h, options);
    case ComplianceMethod::lazy:
    case ComplianceMethod::updown:
      return make_warped_compliance(method, model, h, options);
    case ComplianceMethod::exact:
    case ComplianceMethod::dense:
      break;
  }
  throw std::invalid_argument("this compliance method keeps no reference factor");
}

}  // namespace

std::unique_ptr<Compliance> make_compliance(ComplianceMethod method, const TissueModel& model, double h,
                                            const ComplianceOptions& options) {
  const auto make = [&](const TissueModel& of) -> std::unique_ptr<Compliance> {
    if (method == ComplianceMethod::exact) return make_exact_compliance(of, h, options);
    return make_dense_compliance(of, h, options);
  };
  switch (method) {
    case ComplianceMethod::exact:
    case ComplianceMethod::dense:
      return model.condensed ? make_near_compliance(model, make) : make(model);
    case ComplianceMethod::zone:
    case ComplianceMethod::lazy:
    case ComplianceMethod::updown:
      return make_reference_compliance(method, model, h, options);
  }
  throw std::invalid_argument("this compliance method is not known");
}

std::unique_ptr<ReferenceCompliance> make_reference_compliance(ComplianceMethod method,
                                                               const TissueModel& model, double h,
                                                               const ComplianceOptions& options) {
  const auto make = [&](const TissueModel& of) { return with_reference(method, of, h, options); };
  return model.condensed ? make_near_reference_compliance(model, make) : make(model);
}

ReferenceCompliance* as_reference_compliance(Compliance* compliance) noexcept {
  return dynamic_cast<ReferenceCompliance*>(compliance);
}

}  // namespace hapticd
