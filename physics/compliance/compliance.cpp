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

bool has_reference(ComplianceMethod method) {
  return method == ComplianceMethod::zone || method == ComplianceMethod::lazy ||
         method == ComplianceMethod::updown;
}

std::unique_ptr<Compliance> without_reference(ComplianceMethod method, const TissueModel& model, double h,
                                              const ComplianceOptions& options) {
  if (method == ComplianceMethod::exact) return make_exact_compliance(model, h, options);
  if (method == ComplianceMethod::dense) return make_dense_compliance(model, h, options);
  throw std::invalid_argument("this compliance method is not known");
}

std::unique_ptr<Submodel> near_part(const TissueModel& model) {
  return std::make_unique<Submodel>(model, model.condensed->near_node, model.condensed->near_tet,
                                    model.condensed.get());
}

}  // namespace

std::unique_ptr<Compliance> make_compliance(ComplianceMethod method, const TissueModel& model, double h,
                                            const ComplianceOptions& options) {
  if (model.condensed) return make_compliance(method, near_part(model), h, options);
  if (has_reference(method)) return with_reference(method, model, h, options);
  return without_reference(method, model, h, options);
}

std::unique_ptr<Compliance> make_compliance(ComplianceMethod method, std::unique_ptr<Submodel> near, double h,
                                            const ComplianceOptions& options, std::span<const int> zone) {
  const TissueState& state = near->state;
  if (!has_reference(method))
    return make_near_compliance(
        std::move(near), [&](const TissueModel& of) { return without_reference(method, of, h, options); });
  return make_near_reference_compliance(std::move(near), [&](const TissueModel& of) {
    std::unique_ptr<ReferenceCompliance> made = with_reference(method, of, h, options);
    if (zone.empty()) return made;
    made->move_zone(zone);
    std::unique_ptr<ReferenceFactor> reference = made->snapshot_reference(state);
    reference->make();
    made->adopt_reference(std::move(reference), state);
    return made;
  });
}

std::unique_ptr<ReferenceCompliance> make_reference_compliance(ComplianceMethod method,
                                                               const TissueModel& model, double h,
                                                               const ComplianceOptions& options) {
  const auto make = [&](const TissueModel& of) { return with_reference(method, of, h, options); };
  return model.condensed ? make_near_reference_compliance(near_part(model), make) : make(model);
}

ReferenceCompliance* as_reference_compliance(Compliance* compliance) noexcept {
  return dynamic_cast<ReferenceCompliance*>(compliance);
}

}  // namespace hapticd
