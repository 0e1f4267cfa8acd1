// Hertz with both bodies soft, and the list of the checks.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tools/chart/pieces/piece_check.h"
#include "tools/chart/tissue/tissue_hertz.h"

namespace hapticd {

const std::vector<PieceCheckGroup>& piece_check_groups() {
  static const std::vector<PieceCheckGroup> groups = {{"hertz", check_soft_hertz},
                                                      {"stack", check_stack},
                                                      {"incline", check_incline},
                                                      {"wedge", check_wedge},
                                                      {"impact", check_impact}};
  return groups;
}

void check_soft_hertz(Effort effort, TissueFindings& findings) {
  constexpr double depth = 25e-6;
  const char* source = "Hertz 1882";
  const bool quick = effort == Effort::quick;
  const double exact = hertz_force_of_soft_bodies(depth);
  TissueSeries series{"Hertz, both bodies soft: force", 1, {}, {}};
  for (const int cells : quick ? std::vector{12, 16} : std::vector{16, 24, 34}) {
    // The sphere's a little coarser, so that no two nodes meet.
    const HertzResult r = hertz_of_soft_bodies(depth, cells, cells - 2);
    series.size.push_back(r.element);
    series.error.push_back(std::abs(r.force / exact - 1));
    char name[160];
    std::snprintf(name, sizeof name, "Hertz, both bodies soft: force [N], elements of %.2f contact radii",
                  r.element);
    // Less than the size of elements over the contact's: its edge is between two nodes.
    findings.check(name, exact, r.force, r.element, source);
    findings.check(std::string(name) + ": overlap left [um]", 0, 1e6 * r.penetration, 1, source);
  }
  findings.series.push_back(series);
  const double order = order_of(series), missing = std::max(0.0, 1 - order);
  findings.checks.push_back({"Hertz, both bodies soft: order of convergence, at least", 1, order, missing,
                             0.1, source, missing <= 0.1});
  const int cells = quick ? 12 : 16;
  const double shallow = hertz_of_soft_bodies(0.5 * depth, cells, cells - 2).force,
               deeper = hertz_of_soft_bodies(depth, cells, cells - 2).force;
  findings.check("Hertz, both bodies soft: exponent of the depth", 1.5, std::log2(deeper / shallow), 0.01,
                 source);
}

}  // namespace hapticd
