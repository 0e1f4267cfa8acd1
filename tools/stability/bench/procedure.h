// Several hands that operate on one tissue, each on a device of its own, and what must hold whatever they do.
//
//   each millisecond   encoders read → the daemon, or a baseline → forces → hands and devices (hand_model.h)
//   made   −min Σ_i E_i + ∫ b v_i² dt + W,   E_i = −∫ F_i·dx_i at a port;   at the end, less J a of what tore
//   W      work of the pumps: dW = Σ_n f_n·dx_n + load_i·dX_i of what they pull with (suction.h)
//   pull   of a hand along its port, over p A of the pump
//
// A trial is judged by the worst of its bounds, each over what it allows: swing at rest, energy made, force
// and its change in a tick against the device's limits, pull, and tissue as in every seeded trial
// (trial_tally.h) for the hands' largest speed. Of ∫ b v² only what is damped where there is a force counts
// (closed_loop.h). Times are the script's, which begins when devices are armed. Devices scale alike; their
// axes are the scene's. Deterministic. Units: SI. Errors: as World's.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "tools/offline/baseline_rendering.h"
#include "tools/stability/bench/stability_mode.h"
#include "tools/stability/bench/trial_tally.h"

namespace hapticd {

struct ProcedureHand {
  std::function<Vec3(double)> at;                    // where it wants its device [m]
  std::function<std::uint32_t(double)> pedals = {};  // empty: none is pressed
};

struct Procedure {
  Scene scene;  // an instrument for each hand
  std::vector<ProcedureHand> hands;
  HandSettings grip;                             // of each
  double duration = 0;                           // [s]
  std::vector<std::pair<double, double>> rests;  // in which no hand may swing [s]
  // Elements of the first body that go between two times; empty: none.
  std::function<std::vector<int>(double from, double to)> removed = {};
  // Where the first hand's stiffness is looked at: from … to, pressing along.
  std::pair<double, double> loading;
  Vec3 along = -Vec3::UnitZ();
};

struct ProcedureResult {
  TrialTally tally;
  bool finite = true;
  double swing = 0;                     // of the hands' at rest, beyond two quanta, largest [m]
  double made = 0;                      // [J]
  double absorbed = 0, pumped = 0;      // Σ E_i and W at the end [J]
  double change = 0;                    // of a force in a tick, over the slew limit
  double pull = 0;                      // over p A
  double freed = 0, freed_allowed = 0;  // energy that a free piece made [J]
  double opened = 0;                    // area that tore, in the rest shape [m²]
  int pieces = 0;                       // at the end
  double fastest_hand = 0;              // [m/s]
  std::vector<ClosedLoopTick> first;    // of the first hand, with depth and force along `along`
};

// A grip's encoder and a Touch's limits on every device.
void as_on_a_touch(Procedure& procedure);

// 0 to 1 over 0 ≤ u ≤ 1, without a jump of speed.
double smooth_step(double u);

ProcedureResult run_procedure(const Procedure& procedure, Rendering rendering);

// Judged by the worst bound: above 1 it is broken; worst_of names it.
StabilityTrial trial_of(const ProcedureResult& result);

// Of the tissue, to the first hand where it is looked at, from a run whose forces nobody feels [N/m].
double stiffness_of(Procedure procedure);

// One of the ways in which a mode's procedure is done.
struct ProcedureWay {
  std::string name;
  // lead: how far a hand's spring must be led to be where a rigid hand would be, over that way:
  // 1 + displayed stiffness over the grip's.
  std::function<Procedure(double lead)> made;
};

// The mode that does them at rising displayed stiffness, the worst of all ways; its parameter is still to be
// named.
StabilityPlan procedure_plan(std::vector<ProcedureWay> ways, bool quick);

}  // namespace hapticd
