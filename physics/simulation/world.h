// The simulated world and its 50 Hz step, in the order that keeps the published problem fresh.
//
//   1  removals at the tip; where something went, an interim problem at once   (interim_problem.h)
//   2  rotations, A(u), factor, free motion, for each awake body               (factor_stage.h)
//   3  latch the newest instrument poses, gather the patch, C_pp               (instrument_contact.h)
//   4  contact solve: δ = W λ + δ_free; with bodies that touch in one          (body_contact_stage.h)
//   5  correct: Δx = Δx_free + C Hᵀλ, or so much of it as makes no energy       (energy_bound.h)
//   6  free motion at the new state, same factor, or foreseen where 7 follows  (free_motion.h)
//   7  look ahead: contact at `lead`, and bodies linearised there              (prediction.h)
//   8  fill the condensed problem; the caller publishes it                     (condensed_problem.h)
//   9  after a removal, until the next step: the same for newer poses          (refresh.h)
//
// Factor and free motion of 7 are those of the next step's 2, unless an element goes or the zone moves. A
// body at rest and out of reach, which touches none that moves, sleeps: its step costs nothing. Units: SI.
// Errors: std::runtime_error from the factor of a singular body. Source: the paper §2 and Fig. 2; departures:
// published patch, newest pose, fresh free motion.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "physics/simulation/aspiration/drawing.h"
#include "physics/simulation/body_contact/body_contact_stage.h"
#include "physics/simulation/body_contact/collision.h"
#include "physics/simulation/cutting/cutting_stage.h"
#include "physics/simulation/region/region_stage.h"
#include "physics/simulation/step/instrument_contact.h"
#include "physics/simulation/step/interim_problem.h"
#include "physics/simulation/step/prediction.h"
#include "physics/simulation/step/refresh.h"
#include "physics/simulation/step/removal_stage.h"

namespace hapticd {

class World {
 public:
  // Throws std::invalid_argument for more than `max_instruments` and for contact pairs of no two bodies.
  World(std::vector<BodySettings> bodies, std::vector<Instrument> instruments, const WorldSettings& settings);
  World(std::vector<BodySettings> bodies, Instrument one, const WorldSettings& settings)
      : World(std::move(bodies), std::vector<Instrument>{std::move(one)}, settings) {}
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  // One step of h. `latest` is asked for the newest sample twice: at the start and at the latch.
  // `problem` is written whole, but for `published_ns`. With `publish_interim`, in steps that remove
  // something: it is called with `problem` written a first time, and gives the problem to write the second
  // time.
  StepReport step(const std::function<InstrumentSamples()>& latest, CondensedProblem& problem,
                  const std::function<CondensedProblem&()>& publish_interim = {});

  // The same step in its parts, for whoever has something to do between them
  // (server/schedule/step_schedule.h): 1, with an interim problem where that is not null; 2; and 3 to 8 with
  // the newest sample there is by then. Nothing else may be called in between.
  StepBegin begin_step(const InstrumentSamples& samples, CondensedProblem* interim);
  void factor_step();
  const StepReport& finish_step(const InstrumentSamples& newest, CondensedProblem& problem);

  // Between steps: the next one begins by removing these, whatever the tip does.
  void schedule_removal(int body, std::vector<int> tets) { removal_.schedule(body, std::move(tets)); }
  // … or from its end on these become less (removal_stage.h).
  void schedule_thinning(int body, std::span<const int> tets, double time, double begun) {
    removal_.schedule_thinning(body, tets, time, begun);
  }

  // Between steps, after one that removed something: its problem made again for where the instrument now is,
  // if what is left turns there. False: there is nothing to publish.
  bool wants_refresh() const { return removing_ && looked_ahead_; }
  bool refresh(const InstrumentSamples& samples, CondensedProblem& problem);

  // Between steps, once the last one's problem is published: which faces break in the next.
  void look_for_cracks();

  // Between steps: new reference factors to be made elsewhere, at most one at a time for a body; and back. A
  // body whose reference factor never comes stays right in its zone, and its report says how stale the rest
  // has become.
  // Where a near region follows the instrument, its jobs too.
  std::vector<ReferenceJob> wanted_references();
  void adopt(ReferenceJob job);

  // The problem that the last step published, at another pose and with no contact of the bodies frozen: what
  // the condensed problem approximates. Changes nothing that a step would see but warm starts.
  ContactSolution solve_unfrozen(const InstrumentSamples& samples, const CondensedProblem& published);

  // Before the first step: regions that an instrument may come to (region/region_stage.h). Returns how many.
  int make_regions(const std::function<bool(int made)>& enough) {
    return RegionStage::make(bodies_, settings_, enough);
  }

  // Each step's factor is made for the step to come, which then latches its pose at once.
  bool looks_ahead() const { return prediction_.active() && contacts().empty(); }

  const Bodies& bodies() const { return bodies_; }
  const BodyContacts& contacts() const { return body_contact_.contacts(); }
  const std::vector<Instrument>& instruments() const { return instruments_; }
  // Rows and λ of the last step's contact solve.
  const ContactScratch& contact_scratch() const { return contact_.scratch(); }
  std::uint64_t steps() const { return steps_; }
  int removed() const { return removal_.total(); }
  const CuttingStage& cutting() const { return cutting_; }

 private:
  void publish_contact(const InstrumentSamples& samples, CondensedProblem& problem);
  EachInstrument<double> draw(const InstrumentSamples& samples, CondensedProblem& problem);
  InstrumentPoses poses_in(const InstrumentSamples& samples, double time) const;
  void remove(const InstrumentSamples& samples, StepReport& report);
  bool remove_ahead(std::span<const int> foreseen, const InstrumentSamples& samples, StepReport& report);
  void follow_removal(const Removed& removed, StepReport& report);
  void thin(const InstrumentSamples& samples);
  void flow(const InstrumentSamples& samples, StepReport& report);
  void refit();
  void find_near(const InstrumentSamples& samples);
  void look_again(const InstrumentSamples& samples);
  bool cut(StepReport& report);
  void surfaces_changed(std::span<const int> bodies);
  bool fill_interim(const InstrumentSamples& samples, CondensedProblem& problem, StepReport& report);
  void gather(const InstrumentSamples& samples, bool topology_changed, CondensedProblem& problem,
              StepReport& report);
  std::optional<EachInstrument<Vec6>> wrenches_before_handover(const InstrumentSamples& samples,
                                                               const StepReport& report) const;
  int pressed_condensed_nodes() const;
  void report_compliance(StepReport& report);
  void put_to_sleep();

  WorldSettings settings_;
  std::vector<Instrument> instruments_;
  StepReport report_;             // of the step under way, or the last
  InstrumentSamples begun_with_;  // … and the samples that it began with
  InstrumentPoses placed_;        // where the last step's contact solve left the instruments
  Bodies bodies_;
  Collision collision_;
  std::vector<NearFace> near_;  // of the instruments' newest poses
  bool near_found_ = false;     // in this step

  InstrumentMotions motion_;
  RemovalStage removal_;
  CuttingStage cutting_;
  FactorStage factors_;
  RegionStage regions_;
  InstrumentContact contact_;
  Drawing drawing_;
  BodyContactStage body_contact_;
  Prediction prediction_;
  Refresh refresh_;
  PublishedProblem published_;
  StepContext context_;
  bool removing_ = false;             // this step removed something, or the last one at its end
  bool removed_ahead_ = false;        // … the last one at its end
  bool looked_ahead_ = false;         // … the last one did
  EachInstrument<LumenState> lumen_;  // as the tips took last
  EachInstrument<double> passed_;     // … through them, in a step [m³]
  std::uint64_t steps_ = 0;
};

}  // namespace hapticd
