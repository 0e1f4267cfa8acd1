// Surface that comes to light is nobody's memory. As x_now is what a viscous patch counts from
// (haptic/contact/viscous_patch.h), x_free is moved with it:
//
//   x_eq = (1 + β/h) x_free − (β/h) x    x_now ← x + Δx_pressed,  x_free ← (x_eq + (β/h) x_now) / (1 + β/h)
#include "physics/simulation/step/interim_problem.h"

#include <algorithm>

#include "physics/simulation/step/factor_stage.h"
#include "physics/simulation/step/instrument_contact.h"
#include "physics/simulation/step/interim.h"

namespace hapticd {
namespace {

// False: this body has no condensed system without what went.
bool fill_body(const StepContext& c, int b, std::span<const int> gone, const PatchForce& pressed,
               CondensedProblem& problem) {
  Body& body = c.bodies[b];
  // The patch's nodes, then those that went or are pressed and are not among them.
  std::vector<int> nodes, index, place(body.state.x.size(), -1);
  const auto place_of = [&](int n) {
    if (place[n] < 0) {
      place[n] = static_cast<int>(nodes.size());
      nodes.push_back(n);
    }
    return place[n];
  };
  const auto patch = c.patch.nodes();
  for (std::size_t i = 0; i < patch.size(); ++i)
    if (patch[i].body == b) {
      place_of(patch[i].node);
      index.push_back(static_cast<int>(i));
    }
  const int kept = static_cast<int>(nodes.size());
  if (kept == 0) return true;
  for (const int t : gone)
    for (const int n : body.model.mesh.tets[t]) place_of(n);
  VecX f = VecX::Zero(3 * static_cast<Eigen::Index>(body.state.x.size()));
  for (std::size_t i = 0; i < pressed.nodes.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(3 * i);
    if (pressed.nodes[i].body == b && !pressed.force.segment<3>(at).isZero(0))
      f.segment<3>(3 * place_of(pressed.nodes[i].node)) = pressed.force.segment<3>(at);
  }
  know_free_motion(body, nodes);
  const ComplianceMethod method = c.settings.compliance;
  const int uncovered =
      method == ComplianceMethod::zone || method == ComplianceMethod::exact ? most_outside : 0;
  Condensed condensed;
  if (!woodbury_downdate(body, gone, {}, body.free.ahead ? Linearised::ahead : Linearised::here, c.settings.h,
                         nodes, kept, f.head(3 * static_cast<Eigen::Index>(nodes.size())), uncovered,
                         condensed))
    return false;
  const double viscous = body.model.dynamic ? body.model.material.rayleigh_stiffness / c.settings.h : 0;
  for (int i = 0; i < kept; ++i) {
    const Vec3 &x = body.state.x[nodes[i]], free = condensed.dx_free.segment<3>(3 * i),
               moved = condensed.dx_pressed.segment<3>(3 * i);
    problem.x_now[index[i]] = x + moved;
    problem.x_free[index[i]] = x + free + viscous / (1 + viscous) * moved;
    for (int j = 0; j < kept; ++j)
      problem.C().block<3, 3>(3 * index[i], 3 * index[j]) = condensed.C.block<3, 3>(3 * i, 3 * j);
  }
  return true;
}

}  // namespace

ContactSolution PublishedProblem::solve(const StepContext& c, const InstrumentPoses& X,
                                        const ContactState& before) const {
  ContactState state = before;
  state.frozen_step = 0;  // the rows of that step are in the other scratch
  return solve_contact(*problem, c.instruments, X, c.settings.h, contact_options(c.settings), state,
                       *scratch);
}

bool has_interim_problem(const StepContext& c, const std::vector<std::vector<int>>& gone,
                         const InstrumentSamples& samples) {
  if (!any_present(samples) || c.contacts.any() || c.settings.contact != Renewal::renewed) return false;
  for (int b = 0; b < c.body_count(); ++b)
    if (!gone[b].empty() && c.bodies[b].model.corotational && !c.bodies[b].free.ahead) return false;
  return true;
}

bool fill_interim_problem(const StepContext& c, const std::vector<std::vector<int>>& gone,
                          const PatchForce& pressed, CondensedProblem& problem) {
  problem.C().setZero();
  for (int b = 0; b < c.body_count(); ++b)
    if (c.bodies[b].deformable && !fill_body(c, b, gone[b], pressed, problem)) return false;
  return true;
}

}  // namespace hapticd
