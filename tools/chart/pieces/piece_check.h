// Checks of bodies in contact against answers that one can write down: what the chart prints and tests
// assert.
//
// Kinds of entries and errors as in tissue_check.h; what is expected to be nothing is found in the unit that
// the name gives. Each case is its own entry for each mesh. Units: in the names. Errors: as World's.
#pragma once

#include "tools/chart/tissue/tissue_check.h"

namespace hapticd {

struct PieceCheckGroup {
  const char* name;
  void (*run)(Effort effort, TissueFindings& findings);
};
const std::vector<PieceCheckGroup>& piece_check_groups();

void check_soft_hertz(Effort, TissueFindings&);  // two soft bodies: force against depth
void check_stack(Effort, TissueFindings&);       // blocks at rest: drift
void check_incline(Effort, TissueFindings&);     // sticking and sliding
void check_wedge(Effort, TissueFindings&);       // locking, letting go
void check_impact(Effort, TissueFindings&);      // momentum and third law of two free bodies

}  // namespace hapticd
