// What the ports' vacuum pulls in a step: first where the last step left tips and tissue, then where this
// one's contact solve does, for a step of 20 ms brings other tissue under a port.
//
//   begin: pull of what the ports cover now;   again: of what they cover where the solve with it has ended
//
// A pull that moves neither tip nor tissue by a micrometre is left out, and nothing is solved twice. What a
// solve threw farther than a port is wide and reaches is let go (`let_go`, suction.h): a crumb of 0.01 mm³
// goes centimetres in a step with a hundredth of the pull, in which no linearisation holds. Let go for the
// whole step: in truth it would be for a part of it. Units: suction.h. Guarantee: no allocation once made.
#pragma once

#include <memory>

#include "physics/contact/suction.h"
#include "physics/simulation/step/instrument_motion.h"

namespace hapticd {

class Drawing {
 public:
  // X: where the instruments were left; next: where they are about to be. Returns how far ports are covered.
  EachInstrument<double> begin(Instruments instruments, const InstrumentSamples& samples,
                               const InstrumentPoses& X, const InstrumentPoses& next,
                               CondensedProblem& problem);

  // Whether a solve that ended at x has thrown what is to be let go: `again` will say so.
  bool throws(Instruments instruments, const PatchPositions& x, const CondensedProblem& problem) const;

  // After a solve that ended at X, x: whether it is to be made again, with the pull that problem then has.
  // At first it is; later only where more has been thrown.
  bool again(Instruments instruments, const InstrumentSamples& samples, const InstrumentPoses& X,
             const PatchPositions& x, CondensedProblem& problem, EachInstrument<double>& occlusion);

 private:
  std::unique_ptr<EachInstrument<Grip>> grip_ = std::make_unique<EachInstrument<Grip>>();
  int solves_ = 0;  // since begin
};

}  // namespace hapticd
