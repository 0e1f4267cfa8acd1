#include <algorithm>

#include "physics/contact/solver/coulomb_measures.h"
#include "physics/contact/solver/coulomb_solve.h"

namespace hapticd {
namespace {

constexpr int most_halvings = 5;
constexpr double good_chord = 0.1;    // of the merit left: the LU is good for another step
constexpr double enough = 0.2;        // of a step's length, the least fall of the merit
constexpr double slow = 0.5;          // of the merit left: steps go on without asking
constexpr double worth_a_sweep = 10;  // a full step's merit, of the one before: a sweep may mend it
constexpr double lost = 1e5;      // of the merit: a step taken without asking does not come back from there
constexpr double settling = 0.3;  // of the shift left after a step that served …
constexpr double least_shift = 1e-4;  // … and below this, none
constexpr int dear_steps = 8;         // LUs without time for which roaming is not taken back

}  // namespace

double CoulombSolve::merit_here() const noexcept {
  return alart_curnier(s_, lambda_.data(), ws_.delta.data());
}

void CoulombSolve::put_back(const double* lambda) noexcept {
  std::copy_n(lambda, rows_, lambda_.data());
  s_.compute_delta(lambda_.data(), ws_.delta.data());
}

void CoulombSolve::keep_start() noexcept {
  std::copy_n(lambda_.data(), rows_, ws_.start.data());
  std::copy_n(ws_.delta.data(), rows_, ws_.start_delta.data());
}

// Two sweeps are to end in time from wherever the steps are.
Deadline CoulombSolve::before_polish() const noexcept {
  Deadline deadline = options_.deadline;
  deadline.reserve_ns += 2 * ws_.polish_ns;
  return deadline;
}

// λ and δ at this part of the way from the start to the trial.
void CoulombSolve::take_step(double length) noexcept {
  if (length == 1) {
    std::copy_n(ws_.trial.data(), rows_, lambda_.data());
    std::copy_n(ws_.trial_delta.data(), rows_, ws_.delta.data());
    return;
  }
  for (int k = 0; k < rows_; ++k) {
    lambda_[k] = ws_.start[k] + length * (ws_.trial[k] - ws_.start[k]);
    ws_.delta[k] = ws_.start_delta[k] + length * (ws_.trial_delta[k] - ws_.start_delta[k]);
  }
}

// Steps that lower the merit well. Where none does, contacts that stick are eliminated. Where that does not
// help, some steps are taken without asking, for a direction of slip that turns far raises the merit before it
// falls; unless they end well below, or where they are lost, all is put back. The shift shrinks with every step
// that serves, or the last ones would converge only linearly.
void CoulombSolve::newton(const CoulombStage& stage) noexcept {
  s_.stretch = stage.stretch;
  double merit = merit_here();
  double shift = stage.shift, goal = 0, limit = 0;
  bool fresh = shift > 0, roaming = false, astray = false;
  bool may_eliminate = stage.raw && stage.shift == 0 && stage.stretch == 1;
  int unasked = 0;
  const auto settle = [&] { shift = shift > least_shift ? settling * shift : 0; };
  const auto take_trial = [&] {
    take_step(1);
    merit = merit_here();
    fresh = merit >= goal;
    unasked = fresh ? unasked - 1 : 0;
    astray = merit > limit;
    if (!fresh) settle();
    if (judge(false)) merit = merit_here();
  };
  const Deadline deadline = before_polish();
  while (!done() && !astray && result_.newton < most_newton_) {
    ++result_.newton;
    keep_start();
    const NewtonStep step = newton_step(s_, lambda_.data(), shift, stage.raw, fresh, deadline, ws_);
    result_.factorisations += step.factorisations;
    const bool stepped = step.outcome == NewtonOutcome::stepped;
    if (stepped) s_.compute_delta(ws_.trial.data(), ws_.trial_delta.data());
    const double after = stepped && unasked == 0 ? search(merit) : merit;
    // A slow step is not taken where roaming is still to be tried.
    const bool may_roam =
        stepped && step.factorisations > 0 && !roaming && stage.unasked > 0 && affords(dear_steps);
    if (stepped && unasked > 0) {
      take_trial();
    } else if (after < (may_roam ? slow : 1) * merit) {
      fresh = shift > 0 || after > good_chord * merit;
      merit = after;
      settle();
      if (judge(false)) merit = merit_here();
    } else {
      std::copy_n(ws_.start.data(), rows_, lambda_.data());
      std::copy_n(ws_.start_delta.data(), rows_, ws_.delta.data());
      if (step.outcome == NewtonOutcome::no_time || deadline.passed()) break;
      if (step.factorisations > 0 && (roaming || !stepped)) break;
      if (step.factorisations > 0 && may_eliminate) {
        may_eliminate = false;
        eliminate();
        const double left = merit_here();
        if (left < slow * merit) {
          merit = left;
          fresh = true;
          continue;
        }
      }
      if (step.factorisations > 0) {
        roaming = true;
        unasked = stage.unasked;
        goal = good_chord * merit;
        limit = lost * merit;
        std::copy_n(lambda_.data(), rows_, ws_.turning_point.data());
        if (unasked > 0) take_trial();
      } else {
        fresh = true;
      }
    }
  }
  // Where time ends this, the last step's force is better than what its merit says.
  if (roaming && !done() && merit >= goal && affords(dear_steps)) put_back(ws_.turning_point.data());
}

// From the start towards ws.trial: all of it, with a sweep where single contacts are off, or halving; leaves
// λ and δ there. The merit reached, or the old one.
double CoulombSolve::search(double merit) noexcept {
  take_step(1);
  const double full = merit_here();
  if (full < (1 - enough) * merit) return full;
  if (full < worth_a_sweep * merit) {
    sweep();
    ++result_.sweeps;
    const double swept = merit_here();
    if (swept < (1 - enough) * merit) return swept;
  }
  double length = 0.5;
  for (int halved = 1; halved < most_halvings; ++halved, length *= 0.5) {
    take_step(length);
    const double after = merit_here();
    if (after < (1 - enough * length) * merit) return after;
  }
  return merit;
}

}  // namespace hapticd
