#include "tools/chart/pieces/pieces_report.h"

#include <algorithm>
#include <cstdio>

namespace hapticd {

nlohmann::ordered_json to_json(const StirFigures& f) {
  const Quantiles ms = quantiles(f.step_ms);
  return {
      {"name", f.name},
      {"steps", f.steps},
      {"step_ms", {{"p50", rounded(ms.p50, 2)}, {"p99", rounded(ms.p99, 2)}, {"max", rounded(ms.max, 2)}}},
      {"joint", f.joint},
      {"capped", f.capped},
      {"geometry_held", f.held},
      {"friction_held", f.friction_held},
      {"bounded", f.bounded},
      {"rounds_max", f.rounds},
      {"overlap_um_max", rounded(1e6 * f.overlap, 3)},
      {"tunnelled", f.tunnelled},
      {"touches_max", f.touches},
      {"third_law", f.third_law}};
}

void print(const StirFigures& f) {
  const Quantiles ms = quantiles(f.step_ms);
  std::printf(
      "  %-10s %d steps, %d with contacts of bodies: %d capped, %d with geometry held, %d with friction "
      "held, %d rounds "
      "at most; "
      "step ms p50 %.1f p99 %.1f; %d touches; overlap %.2f um, tunnelled %d; third law %.1e\n",
      f.name.c_str(), f.steps, f.joint, f.capped, f.held, f.friction_held, f.rounds, ms.p50, ms.p99,
      f.touches, 1e6 * f.overlap, f.tunnelled, f.third_law);
}

nlohmann::ordered_json to_json(const TissueCheck& c) {
  return {{"name", c.name},       {"expected", c.reference},
          {"found", c.value},     {"rel_error", c.relative_error},
          {"asked", c.tolerance}, {"passed", c.passed}};
}

void print(const TissueFindings& theory) {
  for (const TissueCheck& c : theory.checks)
    std::printf("  %-5s %-92s %12.6g %12.6g  %.1e of %.0e\n", c.passed ? "ok" : "SHORT", c.name.c_str(),
                c.reference, c.value, c.relative_error, c.tolerance);
  for (const std::string& s : theory.skipped) std::printf("  skip  %s\n", s.c_str());
}

nlohmann::ordered_json to_json(const PieceSolverPoint& p) {
  return {{"name", p.name},
          {"scene", p.scene},
          {"touches", p.touches},
          {"friction", p.friction},
          {"problems", p.problems},
          {"active_max", p.active},
          {"us_p50", rounded(p.us.p50, 1)},
          {"us_p99", rounded(p.us.p99, 1)},
          {"residual_p50", p.residual.p50},
          {"residual_max", p.residual.max},
          {"failures", p.failures},
          {"unfinished", p.unfinished}};
}

void print(const std::vector<PieceSolverPoint>& solvers) {
  std::printf("  %-9s %-20s %7s %8s %8s %10s %10s %9s %9s %8s %10s\n", "solver", "scene", "touches",
              "friction", "problems", "us", "p99 us", "residual", "max", "failures", "unfinished");
  for (const PieceSolverPoint& p : solvers)
    std::printf("  %-9s %-20s %7d %8s %8d %10.1f %10.1f %9.1e %9.1e %8d %10d\n", p.name.c_str(),
                p.scene.c_str(), p.touches, p.friction ? "yes" : "no", p.problems, p.us.p50, p.us.p99,
                p.residual.p50, p.residual.max, p.failures, p.unfinished);
}

nlohmann::ordered_json to_json(const PushPoint& p) {
  return {{"scene", p.scene},
          {"direction", p.direction},
          {"peak_mn", rounded(1e3 * p.peak, 4)},
          {"rms_mn", 1e3 * p.rms},
          {"rms_rel", p.rms_rel},
          {"rms_rel_to_rms", p.rms_rel_to_rms},
          {"max_rel", p.max_rel},
          {"depth_um", rounded(1e6 * p.depth, 1)},
          {"step_rel", p.step_rel},
          {"at_rest_rel", p.at_rest_rel},
          {"touches", p.touches},
          {"active_before", p.active_before},
          {"active_after", p.active_after},
          {"holds", holds(p)},
          {"unsolved", p.unsolved}};
}

void print(const std::vector<PushPoint>& pushes) {
  for (const PushPoint& p : pushes)
    std::printf(
        "  %-28s %-6s force off by %6.2f %% RMS, %6.2f %% at most, of %.3f mN (at rest %.2g %%, the "
        "step's own %.2g %%; %.0f um deep); of %d touches %d bear force, then %d; unsolved %d%s\n",
        p.scene.c_str(), p.direction.c_str(), 100 * p.rms_rel, 100 * p.max_rel, 1e3 * p.peak,
        100 * p.at_rest_rel, 100 * p.step_rel, 1e6 * p.depth, p.touches, p.active_before, p.active_after,
        p.unsolved, holds(p) ? "" : "; the piece has slid from under the tip");
}

}  // namespace hapticd
