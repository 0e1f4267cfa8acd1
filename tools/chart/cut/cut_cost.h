// What a cut costs the model, over how many there were: 2 000 faces opened, then 2 000 elements subdivided.
//
// A blade's path is walked: planes through the lens, one after another, each in lanes as wide as the blade's
// edge, to and fro; what lies on it is cut in that order, face by face and edge by edge. One update is the
// cut, the surface and the compliance that follow it (`reshape`), of method `zone` with a zone of 200 nodes
// at the blade; its reference factors are made between two updates, as if by another thread, when one of the
// 60 nodes nearest to the blade is outside the zone or enough is carried. Errors against a dense or refined solve of the mesh as it is then;
// volume and quality by looking at every element. Units in the names.
#pragma once

#include <functional>
#include <string>

#include "physics/tissue/tissue.h"

namespace hapticd {

struct CutCost {
  int count = 0;    // faces opened, or elements subdivided
  int updates = 0;  // that were timed: an edge's elements are subdivided together
  double update_us_median = 0, update_us_p99 = 0, update_us_max = 0;
  double flatness = 0;  // median of the last tenth over that of the first
  double volume_rel_error = 0;
};

struct CutCostFigures {
  int nodes = 0, tets = 0;  // before
  int nodes_after = 0, tets_after = 0;
  CutCost openings, subdivisions;
  double c_rel_error = 0;     // of C_pp, the larger of those after both
  double quality_before = 0;  // least dihedral quality
  double quality_min = 0;     // … of the elements that cuts made
  int inverted = 0;           // elements without positive volume at rest
  std::string invalid;        // what check_mesh says
  int references = 0;
};

// model: with room for what is asked.
CutCostFigures chart_cut_cost(TissueModel model, int count, double h,
                              const std::function<bool(double)>& progress);

}  // namespace hapticd
