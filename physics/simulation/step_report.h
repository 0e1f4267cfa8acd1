// What a step tells of itself.
//
// Units: SI.
#pragma once

#include <vector>

#include "physics/compliance/compliance.h"
#include "physics/contact/contact_solve.h"
#include "physics/simulation/body_contact/body_contact.h"
#include "physics/simulation/step/removal.h"

namespace hapticd {

struct BodyReport {
  int body;
  ComplianceReport compliance;
};

// What has happened when a step has begun.
struct StepBegin {
  int removed = 0;       // tetrahedra
  bool interim = false;  // a problem without them is to be published
};

struct StepReport {
  int removed = 0;  // tetrahedra that went in this step, aspirated ones included
  int removed_ahead = 0;  // … of them at its end: its problem is the first without them
  int fragments_aspirated = 0;
  bool split = false;        // blades cut, or faces tore
  bool out_of_room = false;  // a cut found no spare node or tetrahedron left, in this step or before
  bool interim = false;      // a problem without them was published at once
  int awake_bodies = 0;
  int references_adopted = 0;      // since the step before
  int synchronous_references = 0;  // made by the step itself, for which others came too late
  int bounded_bodies = 0;   // whose motion was held back, for it would have made energy (energy_bound.h)
  int uncovered_nodes = 0;  // patch nodes outside their compliance's zone: right, but slow
  int regions_entered = 0;  // near regions that follow their instrument to elsewhere
  int condensed_nodes = 0;  // that bear, of condensed tissue, which is rigid: an instrument reaches that far
  ContactSolution contact;
  EachInstrument<double> occlusion;  // of the ports, as the contact solve had them (suction.h)
  EachInstrument<double> flow;       // of fluid into them [m³/s] (inflow.h)
  EachInstrument<LumenState> lumen;  // what is in their bores, and what is too wide for them
  // |f(this step's problem) − f(the one published last)|, both solved at this step's pose [N]: what handing
  // one over for the other does to the force. Of methods that keep reference factors, in steps with a new
  // reference factor or a removal.
  double handover_jump = 0;
  BodyContactReport body_contact;
  std::vector<BodyReport> compliance;  // of awake bodies
};

// A worse contact solve moves nothing; the next step repairs.
inline bool usable(const ContactSolution& s) { return s.status == SolveStatus::solved || s.residual < 1e-3; }

}  // namespace hapticd
