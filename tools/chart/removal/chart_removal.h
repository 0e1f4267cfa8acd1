// The paper's Fig. 4 for every compliance method: what a removal and a patch cost, over the number removed;
// and the same of a blade's cuts, over the number of cuts.
//
// What is removed or cut, and where the instrument is: damage.h. The patch is the 60 live nodes nearest to
// the tip; when they leave the zone, the zone (160 nodes) moves there. Methods that keep a base get the new
// one between two removals or cuts, as if made by another thread: its making is counted apart
// (`reference_ms`). Costs: update_us is `remove`, or the cutting of the mesh and `reshape`, and `update`
// where a method does the step's work there (exact, zone, lazy with a cap); condense_us is `patch`.
// Everything is told; update and patch are timed on removals or cuts evenly spread. Error: ‖C_pp −
// oracle‖/‖oracle‖ on some columns of the patch, the oracle a fresh factor's solves refined twice against an
// A that was assembled independently. Units in the names.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "physics/compliance/compliance.h"
#include "tools/chart/removal/damage.h"

namespace hapticd {

struct ChartMethod {
  std::string name;   // exact, zone, updown, lazy, lazy_rebased, dense
  std::string order;  // zone_last, metis, none
  ComplianceMethod method = ComplianceMethod::exact;
  ComplianceOptions options;
  int most_nodes = 0;  // not charted for larger bodies; 0: no limit
  bool works_in_update = false;
  bool keeps_reference = false;  // whose zone moves with a new base
};

// All rows of the chart, in the order of its legend.
std::vector<ChartMethod> chart_methods();

struct RemovalPoint {
  std::string method, order;
  int nodes = 0, tets = 0;  // to begin with
  int removed = 0;          // elements, or cuts, at the end of the point
  double update_us_median = 0, update_us_p99 = 0;
  double condense_us_median = 0;
  double step_us_median = 0;  // update and condense of one removal
  int timed = 0;              // removals whose update and patch were timed
  int patch_nodes = 0;
  double w_rel_error = 0;
  double memory_mb = 0;
};

// What a base cost, over one run.
struct ReferenceCost {
  std::string method, order;
  int nodes = 0;
  int made = 0;
  double reference_ms_median = 0;  // elsewhere
  double adopt_us_max = 0;         // in the step
};

struct RemovalChart {
  std::vector<RemovalPoint> points;
  std::vector<ReferenceCost> bases;
};

struct ChartSettings {
  double h = 0.02;
  int points = 10;  // flatness compares the last with the first
  int zone_nodes = 160;
  int patch_nodes = 60;
  int timed_per_point = 200;     // updates and patches timed, at most …
  double seconds_per_point = 6;  // … and for no longer (never fewer than two)
  int error_columns = 36;        // of the patch, for the error
};

// The live nodes nearest to a point that a contact could move, nearest first.
std::vector<int> nearest_live_nodes(const TissueModel& model, const TissueState& state, const Vec3& point,
                                    int count);

// Columns of C_pp: rows of all `nodes`, columns of the first `columns`.
MatX oracle_columns(const TissueModel& model, const TissueState& state, double h, std::span<const int> nodes,
                    int columns);

// `progress(fraction of this model, words)` returns false to stop; then what was measured so far is returned.
RemovalChart chart_removals(const TissueModel& model, std::span<const DamageStep> steps,
                            std::span<const ChartMethod> methods, const ChartSettings& settings,
                            const std::function<bool(double, const std::string&)>& progress);

// (update + condense) over the last tenth of the removals / over the first, of one method, order and size.
std::optional<double> flatness(std::span<const RemovalPoint> points, const std::string& method,
                               const std::string& order, int nodes);

// Removals after which `method` is cheaper than `other` for good, between points linearly.
std::optional<double> crossing(std::span<const RemovalPoint> points, const std::string& method,
                               const std::string& other, int nodes);

}  // namespace hapticd
