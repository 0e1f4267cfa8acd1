// Modes of the compliance: removals from tissue that hardly weighs anything, tissue that has turned since its
// compliance was factored.
//
// C_pp of 30 nodes is compared with an independent factor's (chart_removal.h); what a contact solve would
// make of it errs by about as much. Trace: that error over the removals or the angle.
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>

#include "physics/compliance/element_term.h"
#include "physics/compliance/reference_compliance.h"
#include "physics/compliance/system_matrix.h"
#include "tools/chart/removal/chart_removal.h"
#include "tools/chart/removal/chart_warping.h"
#include "tools/stability/stability_plans.h"

namespace hapticd {

namespace {

constexpr double h = 0.02;
constexpr int patch_nodes = 30, zone_nodes = 80;

const char* words(ComplianceHealth health) {
  return health == ComplianceHealth::good       ? ""
         : health == ComplianceHealth::degraded ? "compliance degraded"
                                                : "new reference factor wanted";
}

double relative_error(const MatX& block, const TissueModel& model, const TissueState& state,
                      std::span<const int> patch) {
  const MatX oracle = oracle_columns(model, state, h, patch, static_cast<int>(block.cols()));
  const double error = (block - oracle).norm() / oracle.norm();
  return std::isfinite(error) ? error : std::numeric_limits<double>::infinity();
}

double patch_error(Compliance& compliance, const TissueModel& model, const TissueState& state,
                   std::span<const int> patch) {
  MatX block(3 * patch.size(), 3 * patch.size());
  compliance.patch(patch, block);
  return relative_error(block, model, state, patch);
}

// What the simulation does where a reference factor is wanted, only at once.
void renew_reference(ReferenceCompliance& compliance, const TissueState& state) {
  if (!compliance.report().wants_reference) return;
  std::unique_ptr<ReferenceFactor> factor = compliance.snapshot_reference(state);
  factor->make();
  compliance.adopt_reference(std::move(factor), state);
  compliance.update(state);
}

// The nodes nearest to the middle of the top that still are of some element.
std::vector<int> nodes_at_top(const TissueModel& model, const TissueState& state, int count) {
  Vec3 top = model.mesh.nodes[0];
  for (const Vec3& x : model.mesh.nodes)
    if (x.z() > top.z() + 1e-9) top = x;
  top.x() = top.y() = 0;
  return nearest_live_nodes(model, state, top, count);
}

// The paper's update, to the letter: C ← C − C G Q⁻¹ Gᵀ C, Q = S⁻¹ + Gᵀ C G, S = −a_e (its eqs. 3 to 5). S⁻¹
// exists by the mass alone, and is as large as the mass is small.
class PaperStack {
 public:
  PaperStack(const TissueModel& model, const TissueState& state)
      : model_(model), C_(MatX(assemble_system_matrix(model, state, h)).inverse()) {}

  void remove(const TissueState& state, int tet) {
    const ElementTerm term = element_term(model_, h, tet, 1, state.rotation[static_cast<std::size_t>(tet)],
                                          model_.mesh.tets[static_cast<std::size_t>(tet)]);
    const MatX V = term.V.topLeftCorner(3 * term.corners, term.rank);
    std::vector<int> at;
    std::vector<int> used;
    for (int c = 0; c < term.corners; ++c)
      for (int r = 0; r < 3 && !model_.fixed[static_cast<std::size_t>(term.node[c])]; ++r) {
        at.push_back(3 * term.node[c] + r);
        used.push_back(3 * c + r);
      }
    const MatX a = (V * V.transpose())(used, used), CG = C_(Eigen::all, at);
    const MatX Q = -a.inverse() + C_(at, at);
    C_ -= CG * Q.inverse() * CG.transpose();
  }
  MatX patch(std::span<const int> nodes) const {
    std::vector<int> at;
    for (const int n : nodes)
      for (int r = 0; r < 3; ++r) at.push_back(3 * n + r);
    return C_(at, at);
  }

 private:
  const TissueModel& model_;
  MatX C_;
};

}  // namespace

StabilityPlan plan_near_static(StabilityBench& bench, bool quick) {
  StabilityPlan plan;
  plan.parameter = "mass divided by …, the cube cut in two";
  plan.naive =
      "one low-rank update for each removal, by the inverse of the element's matrix, as in the paper";
  plan.ours = "zone: the element left out, or carried until the next reference factor";
  plan.judged = "error of C_pp";
  plan.limit = 1e-3;
  plan.reason = "10⁴: a step of two seconds instead of 20 ms, or tissue of 0.1 kg/m³";
  plan.required = 1e4;
  plan.trace_x = "elements removed";
  plan.trace_y = "error of C_pp";
  plan.values = quick ? std::vector<double>{1e4, 1e6} : geometric(1, 1e8, 10);
  const auto run = [&bench](double divisor, bool naive) {
    const SceneBody& cube = bench.scene().bodies.front();
    Material material = cube.material;
    material.density /= divisor;
    const TissueModel model = make_tissue_model(cube.mesh, material, cube.fixed_nodes, Vec3::Zero());
    TissueState state = rest_state(model);
    const std::vector<int> zone = nodes_at_top(model, state, zone_nodes),
                           patch(zone.begin(), zone.begin() + patch_nodes);
    // What crosses half the height, in any order: in the end nothing but its mass holds the upper half.
    std::vector<int> order;
    for (int t = 0; t < model.tet_count(); ++t) {
      const auto below = std::count_if(model.mesh.tets[t].begin(), model.mesh.tets[t].end(),
                                       [&](int n) { return model.mesh.nodes[n].z() < 10e-3; });
      if (below > 0 && below < 4) order.push_back(t);
    }
    // But no node loses its last element: a row of zeros has no inverse in any arithmetic.
    std::vector<int> left = state.live_tets_of_node;
    std::erase_if(order, [&](int t) {
      const Tet& nodes = model.mesh.tets[static_cast<std::size_t>(t)];
      const bool last = std::any_of(nodes.begin(), nodes.end(), [&](int n) { return left[n] == 1; });
      if (!last)
        for (const int n : nodes) --left[n];
      return last;
    });
    std::mt19937 random(31);
    for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random() % i]);
    StabilityTrial trial;
    try {
      PaperStack paper(model, state);
      const auto compliance = make_zone_compliance(model, h);
      compliance->move_zone(zone);
      compliance->update(state);
      const std::size_t batch = std::max<std::size_t>(1, order.size() / 12);
      for (std::size_t i = 0; i < order.size(); i += batch) {
        const std::vector<int> some(
            order.begin() + static_cast<std::ptrdiff_t>(i),
            order.begin() + static_cast<std::ptrdiff_t>(std::min(i + batch, order.size())));
        if (naive)
          for (const int t : some) paper.remove(state, t);
        remove_tets(model, state, some);
        if (!naive) {
          compliance->remove(state, some);
          compliance->update(state);
          renew_reference(*compliance, state);
          trial.says = words(compliance->report().health);
        }
        const double error = naive ? relative_error(paper.patch(patch), model, state, patch)
                                   : patch_error(*compliance, model, state, patch);
        trial.judged = std::max(trial.judged, error);
        trial.trace.emplace_back(static_cast<double>(i + some.size()), std::clamp(error, 1e-16, 1e6));
      }
    } catch (const std::runtime_error& error) {
      trial.judged = std::numeric_limits<double>::infinity();
      trial.says = error.what();
    }
    return trial;
  };
  plan.run_naive = [run](double divisor) { return run(divisor, true); };
  plan.run_ours = [run](double divisor) { return run(divisor, false); };
  return plan;
}

// A column of tissue, held at its foot, bends over; its top is where contact would be.
StabilityPlan plan_rotation(StabilityBench& bench, bool quick) {
  StabilityPlan plan;
  plan.parameter = "angle by which tissue bends over [degrees]";
  plan.naive = "the compliance of the rest shape, unturned";
  plan.ours = "zone: turned with its piece, a new reference factor where it asks for one";
  plan.judged = "error of C_pp";
  plan.limit = 0.1;
  plan.reason = "90 degrees: a flap that is folded back";
  plan.required = 90;
  plan.trace_x = "angle [degrees]";
  plan.trace_y = "error of C_pp";
  plan.values = quick ? std::vector<double>{15, 90} : std::vector<double>{5, 10, 15, 30, 45, 60, 90, 105};
  const auto run = [&bench](double degrees, ComplianceMethod method, Warping warping) {
    const SceneBody& cube = bench.scene().bodies.front();
    const TissueModel model = make_tissue_model(cube.mesh, cube.material, cube.fixed_nodes, Vec3::Zero());
    const TissueState rest = rest_state(model);
    ComplianceOptions options;
    options.warping = warping;
    const auto compliance = make_reference_compliance(method, model, h, options);
    const std::vector<int> zone = nodes_at_top(model, rest, zone_nodes),
                           patch = nodes_at_top(model, rest, patch_nodes);
    compliance->move_zone(zone);
    compliance->update(rest);
    double height = 0;
    for (const Vec3& X : model.mesh.nodes) height = std::max(height, X.z());
    StabilityTrial trial;
    constexpr int parts = 8;  // of the way: what asks for a reference factor gets it
    for (int part = 1; part <= parts; ++part) {
      const double angle = degrees * std::numbers::pi / 180 * part / parts;
      TissueState state = rest;
      // An arc of the height; cross-sections stay plane.
      for (std::size_t n = 0; n < state.x.size(); ++n) {
        const Vec3& X = model.mesh.nodes[n];
        const double radius = height / angle, at = X.z() / radius;
        state.x[n] = {radius - (radius - X.x()) * std::cos(at), X.y(), (radius - X.x()) * std::sin(at)};
      }
      update_rotations(model, state);
      compliance->update(state);
      if (method == ComplianceMethod::zone) renew_reference(*compliance, state);
      trial.judged = patch_error(*compliance, model, state, patch);
      trial.trace.emplace_back(degrees * part / parts, trial.judged);
    }
    trial.says = compliance->report().wants_reference ? "new reference factor wanted" : "";
    return trial;
  };
  plan.run_naive = [run](double degrees) { return run(degrees, ComplianceMethod::lazy, Warping::none); };
  plan.run_ours = [run](double degrees) { return run(degrees, ComplianceMethod::zone, Warping::piece); };
  return plan;
}

}  // namespace hapticd
