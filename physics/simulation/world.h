// The simulated world and its 50 Hz step, in the order that keeps the published problem fresh.
//
//   1  removals at the tip, fragments sucked out; where something went, an interim problem (interim.h), which
//      is published at once: else what is gone would be felt until 8
//   2  rotations, A(u), factor, free motion                      (per awake body)
//   3  latch the newest instrument pose, gather the patch, C_pp
//   4  contact solve, geometry renewed three times; of a far pose, on the way to it first    δ = W λ + δ_free
//      (with bodies that touch one another: in one solve with theirs, world_contact.cpp)
//   5  correct: Δx = Δx_free + C Hᵀλ, or so much of it as makes no energy (energy_bound.h); a body that was
//      held back is not looked ahead for in 7
//   6  fresh: f_int and free motion at the new state, same factor; or, where the compliance solves in halves
//      and 7 follows, foreseen from 5 (body.h)
//   7  look ahead: the same contact solve where the instrument will be at `lead`, and all bodies linearised
//      again at what that does to them (predicted_linearisation.h)
//   8  fill the condensed problem                                (the caller publishes it)
//   9  after a step that removed something, until the next: the same problem made again for the newest pose,
//      when and as often as the caller has the time (`refresh`)
//
// Factor and free motion of 7 are those of the next step's 2, unless an element goes or the zone moves: the
// pose is then latched at once. Without a lead it is latched after the factor, and free motion is published
// fresh: a start-of-step pose and a step-old free motion cost most of the accuracy there is
// (haptic/README.md). A deformable body that is at rest and out of reach, and touches none that moves,
// sleeps: its step costs nothing, and what touches it then finds an obstacle, for one step if it moves.
// Units: SI. Shapes: see condensed_problem.h. Errors: std::runtime_error from the factor of a singular
// body. Source: the paper §2 and Fig. 2; departures: published patch, newest pose, fresh free motion.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "physics/contact/contact_solve.h"
#include "physics/simulation/body.h"
#include "physics/simulation/body_contact/body_contact.h"
#include "physics/simulation/body_contact/collision.h"
#include "physics/simulation/patch.h"
#include "physics/simulation/step/interim.h"
#include "physics/simulation/step/pose_predictor.h"
#include "physics/simulation/step/removal.h"

namespace hapticd {

struct WorldSettings {
  double h = 0.02;            // simulation step [s]
  double alarm_distance = 0;  // [m]
  double sample_spacing = 0;  // [m]
  Renewal contact = Renewal::renewed;
  Vec3 gravity = Vec3::Zero();  // [m/s²]
  VirtualCoupling coupling;
  RemovalSettings removal;
  ComplianceMethod compliance = ComplianceMethod::exact;
  ComplianceOptions compliance_options;
  BodyContactSettings body_contact;  // which bodies touch one another; none by default
  int linearisations = 3;            // of a step's contact solve
  CoulombOptions coulomb;
  // Where in its use a published problem is best: this long after its pose was latched [s]; 0: at that pose.
  // Only for renewed contact, and not where bodies touch one another.
  double lead = 0;
  // For comparison only (tools/offline/offline_run.h): the paper keeps the pose of the step's start, and publishes
  // the free motion that the step began with.
  bool newest_pose = true;
  bool fresh_free_motion = true;
  // For comparison only: false lets a linearisation make energy (energy_bound.h).
  bool keeps_energy = true;
};

// A new reference factor that a body's compliance wants: `reference factor->make()` is to be called, on any
// thread, and the job handed back to `World::adopt`, `failed` if that threw.
struct ReferenceJob {
  int body = 0;
  std::unique_ptr<ReferenceFactor> reference;
  bool failed = false;
};

struct BodyReport {
  int body;
  ComplianceReport compliance;
};

// What the simulation knows of the device at one instant, already in the scene.
struct InstrumentSample {
  Pose pose;
  bool present = false;  // no device: no contact, no removal
  bool phaco = false;
  bool aspiration = false;
  double time = 0;  // when that was, on any one clock [s]; 0: a step after the sample before
};

struct StepReport {
  int removed = 0;  // tetrahedra that went in this step, aspirated ones included
  int fragments_aspirated = 0;
  bool interim = false;  // a problem without them was published at once
  int awake_bodies = 0;
  int references_adopted = 0;      // since the step before
  int synchronous_references = 0;  // made by the step itself, for which others came too late
  int bounded_bodies = 0;     // whose motion was held back, for it would have made energy (energy_bound.h)
  int uncovered_nodes = 0;    // patch nodes outside their compliance's zone: right, but slow
  ContactSolution contact;
  // |f(this step's problem) − f(the one published last)|, both solved at this step's pose [N]: what handing
  // one over for the other does to the force. Of methods that keep reference factors, in steps with a new
  // reference factor or a removal.
  double handover_jump = 0;
  BodyContactReport body_contact;
  std::vector<BodyReport> compliance;  // of awake bodies
};

// What a step removes goes when the problem without it is in use, so long after the step's begin [s]; the tip
// is where it will be then.
inline constexpr double removal_lead = 2e-3;

// Rows of the instrument exist for gaps below this, in alarm distances; they are renewed in each solve.
inline constexpr double contact_margin = 0.25;

// A worse contact solve moves nothing; the next step repairs.
inline bool usable(const ContactSolution& s) { return s.status == SolveStatus::solved || s.residual < 1e-3; }

class World {
 public:
  World(std::vector<BodySettings> bodies, Instrument instrument, const WorldSettings& settings);

  // One step of h. `latest` is asked for the newest sample twice: at the start and at the latch.
  // `problem` is written whole, but for `published_ns`. With `publish_interim`, in steps that remove
  // something: it is called with `problem` written a first time, and gives the problem to write the second
  // time.
  StepReport step(const std::function<InstrumentSample()>& latest, CondensedProblem& problem,
                  const std::function<CondensedProblem&()>& publish_interim = {});

  // Between steps: the next one begins by removing these, whatever the tip does.
  void schedule_removal(int body, std::vector<int> tets) { scheduled_.push_back({body, std::move(tets)}); }

  // Between steps, after one that removed something: its problem made again for where the instrument now is,
  // if what is left turns there (world_refresh.cpp). False: there is nothing to publish.
  bool wants_refresh() const { return removing_ && looks_ahead(); }
  bool refresh(const InstrumentSample& sample, CondensedProblem& problem);

  // Between steps: new reference factors to be made elsewhere, at most one at a time for a body; and back. A
  // body whose reference factor never comes stays right in its zone, and its report says how stale the rest
  // has become.
  std::vector<ReferenceJob> wanted_references();
  void adopt(ReferenceJob job) { made_.push_back(std::move(job)); }

  // The problem that the last step published, at another pose and with no contact of the bodies frozen: what
  // the condensed problem approximates. Changes nothing that a step would see but warm starts.
  ContactSolution solve_unfrozen(const InstrumentSample& sample, const CondensedProblem& published);

  const Bodies& bodies() const { return bodies_; }
  const BodyContacts& contacts() const { return contacts_; }
  const Instrument& instrument() const { return *instrument_; }
  // Rows and λ of the last step's contact solve.
  const ContactScratch& contact_scratch() const { return *scratch_; }
  std::uint64_t steps() const { return steps_; }
  int removed() const { return removed_; }

 private:
  void remove_at_tip(const InstrumentSample& sample, StepReport& report);
  void remove_scheduled(StepReport& report);
  int take_from(int body, std::span<const int> tets);
  void removed_from(int body, int gone, StepReport& report);
  void tell_compliances();
  void adopt_references(StepReport& report);
  bool fill_interim(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report);
  struct ZoneNode {
    double distance;  // [m]
    int node;
    bool needed;  // the present zone has to cover it
  };
  std::vector<ZoneNode> zone_at_instrument(const Body& body, const Pose& X) const;
  void update_zone(int body, const InstrumentSample& sample, std::span<const int> nodes);
  bool choose_zone(int body, const Pose* X, std::span<const int> first, std::span<const int> needed);
  void cover(int body, const InstrumentSample& sample, std::span<const int> nodes, StepReport& report);
  void follow_instrument(const InstrumentSample& sample);
  void wake(const InstrumentSample& sample);
  void factor(int body, StepReport& report);
  bool free_motion_plausible(Body& body);
  void make_reference(int body, StepReport& report);
  void factor_and_free_motion(const InstrumentSample& sample, StepReport& report);
  void gather(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report);
  std::vector<int> patch_nodes_of(int body) const;
  void place_patch(CondensedProblem& problem);
  void compliance_of_patch(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report);
  void report_compliance(StepReport& report);
  ContactOptions contact_options() const;
  ContactSolution solve_last_problem(const InstrumentSample& sample);
  void solve_instrument(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report);
  void correct_bodies(StepReport& report);
  void put_to_sleep();
  bool looks_ahead() const;
  bool foresees(const Body& body) const;  // the free motion that it looks ahead from, instead of computing it
  PartTimes* times() const { return settings_.compliance_options.times; }
  void predict_linearisation(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report);
  Pose pose_ahead(const Pose& X) const;
  ContactSolution solve_ahead(const Pose& X, const CondensedProblem& problem);
  VecX force_on_patch(const CondensedProblem& problem, const ContactScratch& scratch) const;

  // Bodies against bodies: world_contact.cpp.
  void find_body_contacts();
  void solve_together(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report);
  void begin_solve(const InstrumentSample& sample, StepReport& report);
  void solve_both(const InstrumentSample& sample, CondensedProblem& problem, StepReport& report);
  void predict_end(int body);
  void wake_touched(const InstrumentSample& sample);
  void condense_bodies(CondensedProblem& problem, StepReport& report);
  VecX remembered_force(const CondensedProblem& problem) const;

  WorldSettings settings_;
  std::unique_ptr<Instrument> instrument_;  // Collision refers to it
  Bodies bodies_;
  Collision collision_;
  PatchGatherer gatherer_;
  ContactState contact_state_;
  std::unique_ptr<CondensedProblem> last_problem_;
  std::unique_ptr<ContactScratch> last_scratch_;
  std::unique_ptr<ContactScratch> scratch_;
  std::vector<NearFace> near_;
  MatX block_;
  VecX patch_force_;  // of the instrument on the patch's nodes [N]
  VecX contact_force_;
  BodyContacts contacts_;
  std::vector<std::vector<Vec3>> x_end_;  // per body: where this step is about to take its nodes
  struct ScheduledRemoval {
    int body;
    std::vector<int> tets;
  };
  std::vector<ScheduledRemoval> scheduled_;
  double removal_budget_ = 0;
  int removed_ = 0;
  bool topology_changed_ = false;
  bool removing_ = false;                          // this step, or the last, removed something
  bool makes_references_ = false;                  // the method keeps reference factors that others make
  std::unique_ptr<ContactScratch> ahead_scratch_;  // only with a lead
  std::vector<std::uint8_t> ahead_;  // per body: its factor and free motion are those of the step to come
  Vec6 twist_ = Vec6::Zero();        // of the instrument, as a displacement per second
  PosePredictor pose_predictor_;
  Pose last_pose_;
  double last_time_ = 0;     // of it [s]
  Vec6 way_ = Vec6::Zero();  // of the instrument, from the step before to this one
  bool was_present_ = false;
  std::vector<std::vector<int>> gone_;  // per body: in this step, and its compliance does not know yet
  std::vector<Condensed> changes_;      // per body: from the last step's problem to its newest refresh
  std::vector<ReferenceJob> made_;      // reference factors to be adopted in the next step
  std::uint64_t steps_ = 0;
  std::uint64_t problems_ = 0;
};

}  // namespace hapticd
