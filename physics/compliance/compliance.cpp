#include "physics/compliance/compliance.h"

#include <stdexcept>

#include "physics/compliance/reference/warped_compliance.h"

namespace hapticd {

void Compliance::finish(const Eigen::Ref<const VecX>& f, Eigen::Ref<VecX> y) {
  static_cast<void>(f);
  static_cast<void>(y);
  throw std::runtime_error("this compliance solves at once");
}

std::unique_ptr<Compliance> make_compliance(ComplianceMethod method, const TissueModel& model, double h,
                                            const ComplianceOptions& options) {
  if (!(h > 0)) throw std::invalid_argument("the time step must be positive");
  switch (method) {
    case ComplianceMethod::exact:
      return make_exact_compliance(model, h, options);
    case ComplianceMethod::zone:
      return make_zone_compliance(model, h, options);
    case ComplianceMethod::lazy:
    case ComplianceMethod::updown:
    case ComplianceMethod::dense:
      return make_warped_compliance(method, model, h, options);
  }
  throw std::invalid_argument("this compliance method is not known");
}

}  // namespace hapticd
