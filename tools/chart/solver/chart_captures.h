// Captured contact problems (hapticd --capture), solved again: what the loop met, with every solver.
//
// `solve_contact` is the loop's own call, geometry and all, from the recorded state (warm) and from none
// (cold); hybrid, pivoting, block_gauss_seidel and pgs solve, cold, the rows of its last linearisation.
// Units: µs in times, N in wrenches. Errors: InputError of read_capture.
#pragma once

#include <filesystem>
#include <functional>

#include "tools/chart/solver/chart_lcp.h"

namespace hapticd {

struct CaptureReport {
  std::string file;
  int rows = 0, contacts = 0, active = 0;
  bool friction = false;
  bool solved_then = false, solved = false;  // in the loop; now
  double residual_then = 0, residual = 0;
  double wrench_difference = 0;  // of now and then, relative to the larger force
  double penetration_um = 0;
};

struct CaptureChart {
  std::vector<CaptureReport> captures;
  std::vector<LcpPoint> points;  // case "captured"
};

CaptureChart chart_captures(const std::vector<std::filesystem::path>& files,
                            const std::function<bool(double)>& progress);

}  // namespace hapticd
