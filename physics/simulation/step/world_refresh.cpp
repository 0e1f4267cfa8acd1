// A problem made again before the next step, after one that removed something.
//
// With rotations held a body is linear, and a problem depends on them alone. As they were foreseen they are
// good enough for a thick body (haptic/README.md). What a removal leaves may be thin: a corner on two
// elements is turned by half a radian, or buckles, in a third of a step. So where the last problem, solved on
// the way to where the instrument is going, says that elements have turned, they get the rotation of there
// (stale_rotation.h):
//
//   Δx = Δx_free + C (f + f_E)      f: contact;  f_E: what the last refresh changed, as a force (interim.h)
//   A' = A + (1 + β/h) Σ_e (k_e(R') − k_e(R)),   from the factor that there is, by Woodbury's formula
//
// Patch and samples stay. Not where a patch node is outside the zone.
#include <utility>

#include "physics/simulation/step/interim.h"
#include "physics/simulation/world.h"

namespace hapticd {
namespace {

constexpr double middle_of_use = 0.15;  // of a step, after the pose
constexpr double least_change = 0.01;   // of the contact's force: an element that is off by less is left

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
  VecX f = VecX::Zero(body.dx_free.size()), dx(body.dx_free.size());
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
  return dx + body.dx_free;
}

}  // namespace

bool World::refresh(const InstrumentSample& sample, CondensedProblem& problem) {
  if (!sample.present || !was_present_ || !wants_refresh() || last_problem_->step == 0) return false;
  const ContactSolution contact =
      solve_ahead(displaced(sample.pose, middle_of_use * settings_.h * twist_), *last_problem_);
  if (!usable(contact) || contact.active == 0) return false;
  const VecX force = force_on_patch(*last_problem_, *ahead_scratch_);
  changes_.resize(bodies_.size());
  bool any = false;
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    Body& body = bodies_[b];
    if (!body.deformable || body.asleep || !ahead_[b]) continue;
    NodeList list(body, static_cast<int>(b), gatherer_.nodes());
    const VecX f = force_on(list, force);
    if (f.isZero(0) || !body.compliance->zone_covers(list.nodes)) continue;
    const std::vector<StaleRotation> stale =
        stale_rotations(body, motion_in_zone(body, list, f, changes_[b]), least_change * f.norm());
    if (stale.empty()) continue;
    for (const StaleRotation& t : stale)
      for (const int n : body.model.mesh.tets[t.tet]) list.add(n);
    Condensed condensed;
    if (!woodbury_downdate(body, {}, stale, Linearised::ahead, settings_.h, list.nodes, list.kept(),
                           VecX::Zero(3 * static_cast<Eigen::Index>(list.nodes.size())), 0, condensed))
      continue;
    for (int i = 0; i < list.kept(); ++i) {
      last_problem_->x_free[list.index[i]] =
          body.state.x[list.nodes[i]] + condensed.dx_free.segment<3>(3 * i);
      for (int j = 0; j < list.kept(); ++j)
        last_problem_->C().block<3, 3>(3 * list.index[i], 3 * list.index[j]) =
            condensed.C.block<3, 3>(3 * i, 3 * j);
    }
    changes_[b] = std::move(condensed);
    any = true;
  }
  if (!any) return false;
  last_problem_->step = ++problems_;
  last_problem_->topology_changed = false;
  problem = *last_problem_;
  return true;
}

}  // namespace hapticd
