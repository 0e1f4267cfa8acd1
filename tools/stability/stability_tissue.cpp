// Modes of the elements: crushed flat by a tool, and nearly incompressible.
#include <cmath>
#include <limits>
#include <numbers>

#include "tools/chart/tissue/tissue_check.h"
#include "tools/offline/stroke_trial.h"
#include "tools/stability/stability_plans.h"

namespace hapticd {

StabilityPlan plan_crushing(StabilityBench&, bool quick) {
  StabilityPlan plan;
  plan.parameter = "depth of a stroke of 20 mm/s with a tip of 0.6 mm into the finer lens [mm]";
  plan.naive = "co-rotational elements alone: they can lose all their volume for nothing";
  plan.ours = "`law: guarded`: a pressure in elements that have all but lost their volume";
  plan.judged = "elements inside out at once";
  plan.limit = 0.5;
  plan.reason = "2 mm: half the lens, three radii of the tip";
  plan.required = 2;
  plan.trace_y = "force on the lens [mN]";
  plan.values = quick ? std::vector<double>{2} : geometric(0.5, 3, std::numbers::sqrt2);
  const auto run = [](double mm, Law law) {
    StrokeSettings s;
    s.mesh = "lens_graded";
    s.law = law;
    s.removal = false;
    s.depth = 1e-3 * mm;
    s.steps = static_cast<int>(std::ceil(2 * (s.depth + 0.2e-3) / s.speed / s.h + 2));  // one stroke
    const StrokeReport r = run_strokes(s, true, [](double) { return true; });
    StabilityTrial trial;
    trial.judged = r.not_finite > 0 ? std::numeric_limits<double>::infinity() : 1.0 * r.most_inverted;
    for (std::size_t i = 0; i < r.force.size(); ++i)
      trial.trace.emplace_back(1e-3 * static_cast<double>(i), 1e3 * r.force[i]);
    return trial;
  };
  plan.run_naive = [run](double mm) { return run(mm, Law::corotational); };
  plan.run_ours = [run](double mm) { return run(mm, Law::guarded); };
  return plan;
}

StabilityPlan plan_incompressible(StabilityBench&, bool quick) {
  StabilityPlan plan;
  plan.parameter = "Poisson's ratio of a half-space pressed on a square";
  plan.naive = "linear tetrahedra as they are: they lock";
  plan.ours = "`poisson_cap: 0.45`";
  plan.judged = "stiffness beyond the exact one [%]";
  // Jones and Hunter 1990, "A perceptual analysis of stiffness": a Weber fraction of 0.23.
  plan.limit = 20;
  plan.reason = "0.499: tissue is mostly water; a fifth is less than hands tell apart in stiffness";
  plan.required = 0.499;
  plan.trace_x = "elements along an edge";
  plan.trace_y = "stiffness over the exact one";
  plan.values =
      quick ? std::vector<double>{0.499} : std::vector<double>{0.3, 0.4, 0.45, 0.47, 0.49, 0.495, 0.499};
  const auto run = [quick](double nu, double cap) {
    StabilityTrial trial;
    // Meshes whose edges meet the square's.
    for (const int n : quick ? std::vector<int>{24} : std::vector<int>{8, 16, 24}) {
      const double stiffness = indentation_stiffness(nu, cap, n);
      trial.trace.emplace_back(n, stiffness);
      trial.judged = 100 * (stiffness - 1);  // of the finest in the end
    }
    return trial;
  };
  plan.run_naive = [run](double nu) { return run(nu, 0.5); };
  plan.run_ours = [run](double nu) { return run(nu, 0.45); };
  return plan;
}

}  // namespace hapticd
