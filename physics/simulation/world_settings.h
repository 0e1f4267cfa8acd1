// What a world is made with, once.
//
// Units: SI.
#pragma once

#include "physics/compliance/compliance.h"
#include "physics/contact/condensed_problem.h"
#include "physics/contact/solver/coulomb.h"
#include "physics/simulation/body_contact/body_contact.h"
#include "physics/simulation/step/removal.h"

namespace hapticd {

struct WorldSettings {
  double h = 0.02;            // simulation step [s]
  double alarm_distance = 0;  // [m]
  double sample_spacing = 0;  // [m]
  Renewal contact = Renewal::renewed;
  Vec3 gravity = Vec3::Zero();  // [m/s²]
  EachInstrument<VirtualCoupling> coupling;
  EachInstrument<RemovalSettings> removal;
  double instrument_friction = 0;  // Coulomb μ where two instruments touch
  ComplianceMethod compliance = ComplianceMethod::exact;
  ComplianceOptions compliance_options;
  BodyContactSettings body_contact;  // which bodies touch one another; none by default
  int linearisations = 3;            // of a step's contact solve
  CoulombOptions coulomb;
  // Where in its use a published problem is best: this long after its pose was latched [s]; 0: at that pose.
  // Only for renewed contact, and not in steps in which bodies may touch one another.
  double lead = 0;
  // For comparison only (tools/offline/offline_run.h): the paper keeps the pose of the step's start, and
  // publishes the free motion that the step began with.
  bool newest_pose = true;
  bool fresh_free_motion = true;
  // For comparison only: false lets a linearisation make energy (energy_bound.h).
  bool keeps_energy = true;
};

// Whether steps end by linearising bodies where the instrument will be (step/prediction.h), those apart in
// which bodies may touch one another.
inline bool predicts(const WorldSettings& s) {
  return s.lead > 0 && s.contact == Renewal::renewed && s.fresh_free_motion;
}

// Whether the method keeps reference factors that others make.
inline bool keeps_references(const WorldSettings& s) {
  return s.compliance == ComplianceMethod::zone || s.compliance == ComplianceMethod::lazy;
}

// What a step removes goes when the problem without it is in use, so long after the step's begin [s]; the tip
// is where it will be then.
inline constexpr double removal_lead = 2e-3;

// Rows of the instrument exist for gaps below this, in alarm distances; they are renewed in each solve.
inline constexpr double contact_margin = 0.25;

}  // namespace hapticd
