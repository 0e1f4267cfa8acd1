// What cutting one body needs besides the body: star index, the cuts of each blade, and what changed since
// the last step. Made at the start, with all room. Units: m, rest shape.
#pragma once

#include <vector>

#include "physics/contact/instruments.h"
#include "physics/cutting/blade_cut.h"
#include "physics/cutting/breaking.h"
#include "physics/cutting/cut_workspace.h"
#include "physics/cutting/swept_surface.h"
#include "physics/cutting/topology_change.h"

namespace hapticd {

struct CutBody {
  CutBody(TissueModel& model, int blades)
      : work(model), change(model), strip(max_edge_samples + 1), of_blade(blades, BladeCut(model)) {}

  CutWorkspace work;
  TopologyChange change;  // of this step
  SweptSurface strip;
  std::vector<BladeCut> of_blade;
  RefusedBreaks refused;
  std::vector<int> breaking;            // faces, when they were last looked for
  int removed_then = 0, cuts_then = 0;  // … tetrahedra, and Body::topology
  std::vector<int> cleft_nodes;         // of faces where cracks begin, and every node that came since
  int removed_before = 0;               // tetrahedra, when hinges were last looked for
};

}  // namespace hapticd
