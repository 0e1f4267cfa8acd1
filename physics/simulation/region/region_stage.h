// Near regions that follow the instruments: which is wanted next, and when it is entered.
//
//   place   where the first instrument that is there is in the tissue's rest shape, a little ahead of it
//   entry   of the made region nearest to the place, where it is nearer by a quarter of the spacing than the
//           present one's, or where the present one's far tissue was made anew    (region_entry.h)
//   made    the region nearest to the place whose far tissue is not made, or lost something since; beyond
//           its neighbours only those of the surface, where instruments come first, within two radii
//
// One entry and one region are under way at a time for a body. A step never waits: until the next region is
// entered, an instrument that leaves the present one meets tissue that is rigid, and the step reports that
// (StepReport::condensed_nodes). Units: m, steps. Errors: a region whose job `failed` is left out from then
// on.
#pragma once

#include <functional>
#include <vector>

#include "physics/simulation/step/reference_scheduling.h"
#include "physics/simulation/step_context.h"

namespace hapticd {

class RegionStage {
 public:
  explicit RegionStage(std::size_t bodies) : progress_(bodies) {}

  // Once in a step: what went of each body.
  static void follow(Bodies& bodies, const std::vector<std::vector<int>>& gone);

  // Before the first step: regions around those that bodies begin in, nearest first, until that is enough.
  // Returns how many.
  static int make(Bodies& bodies, const WorldSettings& settings, const std::function<bool(int made)>& enough);

  // Between steps.
  void wanted(const StepContext& c, std::vector<ReferenceJob>& jobs);
  void adopt(ReferenceJob job) { made_.push_back(std::move(job)); }

  // At the place where reference factors are taken over. Returns the bodies that are in another region.
  std::vector<int> take_over(Bodies& bodies);

 private:
  struct Progress {
    bool entry_under_way = false, making = false;
    int steps = 0, last_steps = 2;  // of the entry under way, of the last
  };

  std::vector<Progress> progress_;
  std::vector<ReferenceJob> made_;
};

}  // namespace hapticd
