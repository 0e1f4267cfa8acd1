// What every stage of a step reads beside its own inputs, and the bodies that it works on.
#pragma once

#include "physics/contact/instrument.h"
#include "physics/simulation/body.h"
#include "physics/simulation/patch.h"
#include "physics/simulation/step/instrument_motion.h"
#include "physics/simulation/world_settings.h"

namespace hapticd {

struct StepContext {
  const WorldSettings& settings;
  const std::vector<Instrument>& instruments;
  const InstrumentMotions& motion;
  const PatchGatherer& patch;    // gathered last
  const BodyContacts& contacts;  // found last
  Bodies& bodies;

  PartTimes* times() const { return settings.compliance_options.times; }
  int body_count() const { return static_cast<int>(bodies.size()); }
};

inline bool is_awake(const Body& body) { return body.deformable && !body.asleep; }

}  // namespace hapticd
