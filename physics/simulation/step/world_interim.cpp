// The problem that is published as soon as a step has decided what goes (interim.h).
//
// Gathered anew, at the step's own pose and on the new surface; C_pp and free motion are those of the factor
// that the last published problem was made with, less what went. Surface that comes to light is nobody's
// memory: it begins where the last problem's contact, solved here at the present pose, holds it, and as x_now
// is what a viscous patch counts from (haptic/viscous_patch.h), x_free is moved with it:
//
//   x_eq = (1 + β/h) x_free − (β/h) x    x_now ← x + Δx_pressed,  x_free ← (x_eq + (β/h) x_now) / (1 + β/h)
#include <algorithm>

#include "physics/simulation/step/interim.h"
#include "physics/simulation/world.h"

namespace hapticd {
namespace {

constexpr int most_uncovered = 12;  // of a body's nodes in an interim problem

}  // namespace

bool World::fill_interim(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report) {
  if (!sample.present || !contacts_.empty() || settings_.contact != Renewal::renewed ||
      last_problem_->step == 0)
    return false;
  const Within condense(times(), StepPart::condense);
  for (std::size_t b = 0; b < bodies_.size(); ++b)
    if (!gone_[b].empty() && bodies_[b].model.corotational && !ahead_[b]) return false;

  const std::vector<PatchNode> before(gatherer_.nodes().begin(), gatherer_.nodes().end());
  VecX force = VecX::Zero(3 * static_cast<Eigen::Index>(before.size()));
  InstrumentSample then = sample;
  then.pose = displaced(sample.pose, removal_lead * twist_);
  if (usable(solve_last_problem(then))) force = force_on_patch(*last_problem_, *last_scratch_);

  gather(sample, problem, report);
  problem.C().setZero();
  const auto patch = gatherer_.nodes();
  // Method zone alone gives what is outside its zone, at half a solve for each.
  const int uncovered = settings_.compliance == ComplianceMethod::zone ? most_uncovered : 0;
  Condensed condensed;
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    Body& body = bodies_[b];
    if (!body.deformable) continue;
    // The patch's nodes, then those that went or are pressed and are not among them.
    std::vector<int> nodes, index, place(body.state.x.size(), -1);
    const auto place_of = [&](int n) {
      if (place[n] < 0) {
        place[n] = static_cast<int>(nodes.size());
        nodes.push_back(n);
      }
      return place[n];
    };
    for (std::size_t i = 0; i < patch.size(); ++i)
      if (patch[i].body == static_cast<int>(b)) {
        place_of(patch[i].node);
        index.push_back(static_cast<int>(i));
      }
    const int kept = static_cast<int>(nodes.size());
    if (kept == 0) continue;
    for (const int t : gone_[b])
      for (const int n : body.model.mesh.tets[t]) place_of(n);
    VecX f = VecX::Zero(3 * static_cast<Eigen::Index>(body.state.x.size()));
    for (std::size_t i = 0; i < before.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(3 * i);
      if (before[i].body == static_cast<int>(b) && !force.segment<3>(at).isZero(0))
        f.segment<3>(3 * place_of(before[i].node)) = force.segment<3>(at);
    }
    know_free_motion(body, nodes);
    if (!woodbury_downdate(body, gone_[b], {}, ahead_[b] ? Linearised::ahead : Linearised::here, settings_.h,
                           nodes, kept, f.head(3 * static_cast<Eigen::Index>(nodes.size())), uncovered,
                           condensed))
      return false;
    const double viscous = body.model.dynamic ? body.model.material.rayleigh_stiffness / settings_.h : 0;
    for (int i = 0; i < kept; ++i) {
      const Vec3 &x = body.state.x[nodes[i]], free = condensed.dx_free.segment<3>(3 * i),
                 pressed = condensed.dx_pressed.segment<3>(3 * i);
      problem.x_now[index[i]] = x + pressed;
      problem.x_free[index[i]] = x + free + viscous / (1 + viscous) * pressed;
      for (int j = 0; j < kept; ++j)
        problem.C().block<3, 3>(3 * index[i], 3 * index[j]) = condensed.C.block<3, 3>(3 * i, 3 * j);
    }
  }
  return true;
}

}  // namespace hapticd
