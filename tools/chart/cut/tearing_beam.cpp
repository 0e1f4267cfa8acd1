#include "tools/chart/cut/tearing_beam.h"

#include <algorithm>
#include <cmath>

#include "physics/compliance/compliance.h"
#include "physics/cutting/breaking.h"
#include "physics/cutting/opening.h"
#include "physics/cutting/tearing.h"
#include "tests/support/mesh_shapes.h"
#include "tools/chart/tissue/tissue_static.h"

namespace hapticd {
namespace {

constexpr double young = 1e5, arm = 5e-3, toughness = 5;  // Pa, m, J/m²
constexpr double length = 24 * arm, first_crack = 10 * arm, last_crack = 11 * arm;
constexpr double tiny = 1e-9;
constexpr double step = 0.02;  // of the compliance [s]

double theory(double crack, double width) {
  return std::sqrt(toughness * young * arm * arm * arm / 12) * width / (crack + 0.64 * arm);
}

// Which faces go next, what they release, and where the crack is.
struct Next {
  std::vector<int> faces;
  double release = 0, front = 0;
};

Next next_of_front(const TissueModel& model, const TissueState& state, const BoundarySurface& surface) {
  Next next;
  for (const FrontEdge& f : crack_fronts(model, state, surface, arm / 2))
    if (f.release > next.release)
      next = {{f.face}, f.release, 0.5 * (model.mesh.nodes[f.a].x() + model.mesh.nodes[f.b].x())};
  return next;
}

bool in_middle_plane(const TissueModel& model, const Triangle& face) {
  return std::all_of(face.begin(), face.end(),
                     [&](int n) { return std::abs(model.mesh.nodes[n].z() - arm) < tiny; });
}

// The largest toughness that breaks something in the middle plane, which is where the crack stays.
Next next_of_faces(const TissueModel& model, const TissueState& state, const BoundarySurface& surface,
                   CutWorkspace& work) {
  const auto compliance = make_compliance(ComplianceMethod::exact, model, step);
  compliance->update(state);
  TearSettings settings{.begins = true};
  settings.clefts.assign(4 * model.mesh.tets.size(), 0);
  double low = 0, high = 0;
  for (int id = 0; id < 4 * model.tets_in_use; ++id) {
    if (model.across[id] < 0 || !in_middle_plane(model, outward_face(model.mesh.tets[id / 4], id % 4)))
      continue;
    settings.clefts[id] = 1;
    high = std::max(high, release_of_face(model, state, id));
  }
  Next next;
  while (high - low > 1e-3 * high) {
    settings.toughness = 0.5 * (low + high);
    const std::vector<int> faces =
        faces_that_break(model, state, surface, work, settings, {}, nullptr,
                         [&](const VecX& f, VecX& dx) { compliance->apply(f, dx); });
    if (faces.empty()) {
      high = settings.toughness;
      continue;
    }
    low = settings.toughness;
    next = {faces, low, length};
    for (const int id : faces)
      for (const int n : outward_face(model.mesh.tets[id / 4], id % 4))
        next.front = std::min(next.front, model.mesh.nodes[n].x());
  }
  return next;
}

TearingBeam tear_beam(int n, TearRule rule) {
  const double width = arm / n;
  const int along = static_cast<int>(std::lround(length / arm)) * n;
  TissueModel model = make_tissue_model(box_mesh({length, width, 2 * arm}, along, 1, 2 * n),
                                        {young, 0, 1000, 0, 0}, {}, Vec3::Zero(), {4 * along, 0});
  TissueState state = rest_state(model);
  BoundarySurface surface(model.mesh);
  CutWorkspace work(model);
  TopologyChange change(model);

  const auto open = [&](std::vector<int> faces) {
    change.clear();
    const bool done = open_faces(model, state, work, faces, change) == CutStatus::done;
    surface.follow(model, change.tets, change.opened);
    return done;
  };
  std::vector<int> notch;
  for (int id = 0; id < 4 * model.tets_in_use; ++id) {
    const Triangle f = outward_face(model.mesh.tets[id / 4], id % 4);
    const bool in_notch = in_middle_plane(model, f) && std::all_of(f.begin(), f.end(), [&](int k) {
                            return model.mesh.nodes[k].x() < first_crack + tiny;
                          });
    if (in_notch && model.across[id] > id) notch.push_back(id);
  }
  TearingBeam beam;
  beam.across_arm = n;
  beam.nodes = model.nodes_in_use;
  if (!open(notch)) return beam;

  double load_sum = 0, theory_sum = 0;
  for (int torn = 0; torn < 40 * n;) {
    Held held;
    for (int axis = 0; axis < 3; ++axis)
      hold(
          model, axis, [&](const Vec3& X) { return axis == 1 || X.x() > length - tiny; }, held);
    for (int k = model.nodes_in_use; k < model.node_count(); ++k)
      for (int axis = 0; axis < 3; ++axis) held[3 * k + axis] = 0;
    // Unit loads on the arms' ends: up on the upper, down on the lower.
    VecX load = VecX::Zero(3 * model.node_count());
    int upper = 0, lower = 0;
    const auto side = [&](int k) {  // of a node at the loaded end, away from the crack's plane
      const Vec3& X = model.mesh.nodes[k];
      if (X.x() > tiny) return 0;
      return X.z() > arm + tiny ? 1 : X.z() < arm - tiny ? -1 : 0;
    };
    for (int k = 0; k < model.nodes_in_use; ++k) {
      upper += side(k) > 0;
      lower += side(k) < 0;
    }
    for (int k = 0; k < model.nodes_in_use; ++k)
      if (const int s = side(k); s != 0) load[3 * k + 2] = s > 0 ? 1.0 / upper : -1.0 / lower;
    const VecX u = solve_linear(model, load, held);
    // Linear: J grows with the square of the load. A load so small that nothing turns tells it.
    const double small = 1e-6 * arm / u.lpNorm<Eigen::Infinity>();
    for (int k = 0; k < model.node_count(); ++k)
      state.x[k] = model.mesh.nodes[k] + small * u.segment<3>(3 * k);
    update_rotations(model, state);
    const auto [faces, release, front] = rule == TearRule::front ? next_of_front(model, state, surface)
                                                                 : next_of_faces(model, state, surface, work);
    if (faces.empty() || front > last_crack) break;
    load_sum += small * std::sqrt(toughness / release);
    theory_sum += theory(front, width);
    ++torn;
    beam.torn = torn;
    if (!open(faces)) break;
  }
  if (beam.torn > 0) {
    beam.load_n = load_sum / beam.torn;
    beam.theory_n = theory_sum / beam.torn;
  }
  return beam;
}

}  // namespace

std::vector<TearingBeam> chart_tearing_beam(const std::vector<int>& across_arm, TearRule rule) {
  std::vector<TearingBeam> beams;
  for (const int n : across_arm) beams.push_back(tear_beam(n, rule));
  return beams;
}

}  // namespace hapticd
