// The stage of a step in which bodies touch bodies, solved together with the instrument.
//
//   find      who may touch whom, before the zones are chosen
//   solve     [rows of the instrument and of the bodies at the last solve's state → one solve of all] …
//             until neither force nor geometry changes (anderson_mixing.h); where they go round in circles,
//             geometry is held
//   condense  contacts at the state just reached and under its free motion, eliminated from what is published
//
// Taking turns instead (bodies given the force, the instrument on their condensed response) does not
// converge: what the instrument starts to slide is stuck in one turn and thrown in the next. A surface node
// that would end inside another body without a contact joins, and the solve is repeated from where it ended.
// Units: m, N. Errors: by status.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "physics/simulation/step/instrument_contact.h"

namespace hapticd {

class InstrumentSide;

class BodyContactStage {
 public:
  explicit BodyContactStage(const WorldSettings& settings);
  ~BodyContactStage();

  const BodyContacts& contacts() const { return contacts_; }

  // Elements of this body went: what lay on it may have nothing to lie on now, and wakes.
  void surface_changed(Bodies& bodies, int body);

  // Who sleeps and is touched by what moves wakes.
  void find(Bodies& bodies);

  // last: InstrumentContact::solve. draft: it only tells where suction will draw, in two rounds and with the
  // contacts that are known; another solve follows, and goes on from where this one ended. in_vain: whether
  // what was just solved is to be made again whatever joins; then nothing is looked for.
  void solve(const StepContext& c, FactorStage& factors, InstrumentContact& contact,
             const InstrumentSamples& samples, const CondensedProblem& problem,
             const std::optional<EachInstrument<Vec6>>& last, bool draft,
             const std::function<bool()>& in_vain, StepReport& report);

  // One attempt of it, with the contacts that are known.
  void solve_once(const StepContext& c, FactorStage& factors, InstrumentContact& contact,
                  const InstrumentSamples& samples, const CondensedProblem& problem,
                  const std::optional<EachInstrument<Vec6>>& last, bool draft, StepReport& report);

  // Of each body's nodes, to the forces of the last solve; empty: not known.
  std::span<const VecX> responses() const { return responses_; }

  // Nothing where nothing touches. patch_force: of the instrument [N].
  void condense(const Bodies& bodies, const VecX& patch_force, CondensedProblem& problem, StepReport& report);

 private:
  void begin_solve(const StepContext& c, FactorStage& factors, const InstrumentSamples& samples,
                   const CondensedProblem& problem, StepReport& report);
  void hold_geometry(const StepContext& c, const std::function<void()>& solve);
  VecX linearisation_point() const;
  void linearise_at(const VecX& point);
  void predict_end(const StepContext& c, int body, const VecX& patch_force);
  void wake_touched(const StepContext& c, FactorStage& factors, const InstrumentSamples& samples);

  BodyContacts contacts_;
  std::vector<VecX> responses_;
  std::vector<std::vector<Vec3>> x_end_;  // per body: where this step is about to take its nodes
  bool known_end_ = false;                // … as an attempt before this one found
  std::unique_ptr<InstrumentSide> tool_;  // … which left the instruments so; none: with none in touch
  VecX tool_force_;                       // … and their force on the patch's nodes [N]
  std::vector<std::vector<int>> known_;   // per body: nodes whose C, of this step's factor, is there
};

}  // namespace hapticd
