// The equations of a refresh:
//
//   Δx = Δx_free + C (f + f_E)      f: contact;  f_E: what the last refresh changed, as a force (interim.h)
//   A' = A + (1 + β/h) Σ_e (k_e(R') − k_e(R)),   from the factor that there is, by Woodbury's formula
#include "physics/simulation/step/refresh.h"

#include <utility>

#include "physics/simulation/step/factor_stage.h"

namespace hapticd {
namespace {

constexpr double least_change = 0.01;  // of the contact's force: an element that is off by less is left

// The patch's nodes of one body, then whatever else is asked for.
class NodeList {
 public:
  NodeList(const Body& body, int b, std::span<const PatchNode> patch) : place_(body.state.x.size(), -1) {
    for (std::size_t i = 0; i < patch.size(); ++i)
      if (patch[i].body == b && add(patch[i].node)) index.push_back(static_cast<int>(i));
  }

  bool add(int n) {
    if (place_[n] >= 0) return false;
    place_[n] = static_cast<int>(nodes.size());
    nodes.push_back(n);
    return true;
  }
  int kept() const { return static_cast<int>(index.size()); }

  std::vector<int> nodes;
  std::vector<int> index;  // of the first, into the patch

 private:
  std::vector<int> place_;
};

VecX force_on(const NodeList& list, const VecX& patch_force) {
  VecX f(3 * list.kept());
  for (int i = 0; i < list.kept(); ++i)
    f.segment<3>(3 * i) = patch_force.segment<3>(3 * static_cast<Eigen::Index>(list.index[i]));
  return f;
}

// Of the zone's nodes, under a force on the list's first; right nowhere else.
VecX motion_in_zone(Body& body, const NodeList& list, const VecX& force, const Condensed& change) {
  VecX f = VecX::Zero(body.free.dx.size()), dx(body.free.dx.size());
  for (int i = 0; i < list.kept(); ++i) f.segment<3>(3 * list.nodes[i]) = force.segment<3>(3 * i);
  if (!change.changed.empty()) {
    const VecX of_change = force_of_change(change, force);
    for (std::size_t g = 0; g < change.changed.size(); ++g)
      f.segment<3>(3 * change.changed[g]) += of_change.segment<3>(static_cast<Eigen::Index>(3 * g));
  }
  if (body.references)
    body.references->apply_in_zone(f, dx);
  else
    body.compliance->apply(f, dx);
  return dx + body.free.dx;
}

}  // namespace

bool Refresh::apply_to_body(const StepContext& c, int b, const VecX& patch_force, CondensedProblem& problem) {
  Body& body = c.bodies[b];
  NodeList list(body, b, c.patch.nodes());
  const VecX f = force_on(list, patch_force);
  if (f.isZero(0) || (body.references && !body.compliance->zone_covers(list.nodes))) return false;
  const std::vector<StaleRotation> stale =
      stale_rotations(body, motion_in_zone(body, list, f, changes_[b]), least_change * f.norm());
  if (stale.empty()) return false;
  for (const StaleRotation& t : stale)
    for (const int n : body.model.mesh.tets[t.tet]) list.add(n);
  Condensed condensed;
  if (!woodbury_downdate(body, {}, stale, Linearised::ahead, c.settings.h, list.nodes, list.kept(),
                         VecX::Zero(3 * static_cast<Eigen::Index>(list.nodes.size())),
                         c.settings.compliance == ComplianceMethod::exact ? most_outside : 0, condensed))
    return false;
  for (int i = 0; i < list.kept(); ++i) {
    problem.x_free[list.index[i]] = body.state.x[list.nodes[i]] + condensed.dx_free.segment<3>(3 * i);
    for (int j = 0; j < list.kept(); ++j)
      problem.C().block<3, 3>(3 * list.index[i], 3 * list.index[j]) = condensed.C.block<3, 3>(3 * i, 3 * j);
  }
  changes_[b] = std::move(condensed);
  return true;
}

bool Refresh::apply(const StepContext& c, const VecX& patch_force, CondensedProblem& problem) {
  changes_.resize(c.bodies.size());
  bool any = false;
  for (int b = 0; b < c.body_count(); ++b)
    if (is_awake(c.bodies[b]) && c.bodies[b].free.ahead)
      any = apply_to_body(c, b, patch_force, problem) || any;
  return any;
}

}  // namespace hapticd
