// A hand on a device on a renderer, closed and offline: what a replayed trajectory cannot show.
//
//   each millisecond   encoder reads x (quantum) → network → renderer → force, delayed → hand and device
//                      (hand_model.h) move in `substeps` parts of it
//
// A hand may turn as well: the same model in angles, its x a rotation vector beside `orientation`, in rad,
// kg·m², N·m/rad, N·m·s/rad, driven by the torque. Of states that arrive in one tick the last is seen.
// The hand presses to `depth`, holds, goes `deeper`, holds again, and, if it is to, lets go, as HandScripts
// of `haptic hand` do: what a wall stores hides what it makes until then. Judged at rest: a loop is stable
// where neither hold ends in a swing, and where nothing went on making energy:
//   swing       peak to peak of x along the press in the last half of a hold [m]
//   stiffness   (F̄₂ − F̄₁)/(x̄₁ − x̄₂) between the holds: what the hand really felt, however it came about [N/m]
//   energy      E = −∫ F·v dt, what the renderer took in; least value [J]. Below zero it made energy
//   surplus     least value of E + ∫ b v² dt, b the device's own damping: below zero, renderer and device
//               together made energy: Colgate's condition, on this motion. Of the integral only ticks with a
//               force and the one before count: what is damped on the way to a wall would else be credit
//               for what the wall makes (at 0.5 N·s/m the approach is worth 60 µJ, a press 30)
// Both energies count the turning too. Deterministic. Units: SI, device frame. Errors: std::invalid_argument
// as check(HandSettings).
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "tools/client/hand_model.h"
#include "tools/offline/renderer.h"

namespace hapticd {

struct ClosedLoopSettings {
  HandSettings hand;
  Press press;              // its hold is the first; then `deeper`, held as long
  double deeper = 0.3e-3;   // [m]
  double encoder_zero = 0;  // along the press: it reads whole quanta beside this [m]
  Quat orientation = Quat::Identity();
  bool let_go = false;
  bool guided = false;  // on a linear stage along the press: forces aside are the stage's
  double arm = 0.2;     // the first pose is held so long before the press [s]
  int substeps = 10;
  std::optional<HandSettings> turning;
  // Ticks that the state of tick i is on its way; below zero: lost. Empty: none.
  std::function<int(std::int64_t)> underway;
  bool renumbered = false;           // states are numbered as they arrive: nobody can tell that one is old
  std::function<Vec3(double)> sway;  // added to the hand's target [m]; empty: none
  std::function<std::uint32_t(double)> buttons;  // empty: none is pressed
  std::function<double()>
      taken_elsewhere;  // energy that the renderer took in at other hands since the start [J]
};

struct ClosedLoopTick {
  double t = 0;
  double depth = 0;           // along the press, from its start [m]
  double force = 0;           // against the press [N]
  double size = 0;            // |F| [N]
  double step = 0;            // |F − F of the tick before| [N]
  double torque = 0;          // |τ| [N·m]
  double turn = 0;            // of the hand, |rotation vector| [rad]
  double energy = 0;          // what the renderer has taken in since the start [J]
  std::uint64_t problem = 0;  // simulation step of the condensed problem
  std::uint32_t status = 0;
};

struct ClosedLoopResult {
  std::vector<ClosedLoopTick> ticks;
  double swing = 0;                          // larger of the two holds' [m]
  double turning = 0;                        // the same of the hand's turn [rad]
  double stiffness = 0;                      // [N/m]
  double force = 0;                          // of the second hold [N]
  double energy_min = 0;                     // [J]
  double surplus_min = 0, surplus_end = 0;   // [J]
  double force_max = 0, force_step_max = 0;  // of |F|; its largest change in a millisecond [N]
  std::uint32_t status = 0;                  // every bit that was set after arming
  bool finite = true;
};

ClosedLoopResult run_closed_loop(Renderer& renderer, const ClosedLoopSettings& settings);

}  // namespace hapticd
