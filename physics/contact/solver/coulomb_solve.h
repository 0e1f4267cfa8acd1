// How the Coulomb solver (coulomb.h) goes about one problem: sweeps and Newton in turns, a
// raised diagonal where they stall, and proximal rounds that take it off again.
//
// coulomb_solve.cpp holds the turns, the rounds, the sweeps and what is judged best; coulomb_descent.cpp the
// steps: newton, search. Guarantee: wait-free, no allocation; bounded by CoulombOptions.
#pragma once

#include "physics/contact/solver/coulomb_newton.h"

namespace hapticd {

// How Newton is run, one after the other: ρ, the first shift of the Jacobian's diagonal, whether steps may
// leave the cones (raw), and how many are taken without asking where none lowers the merit.
struct CoulombStage {
  double stretch, shift;
  bool raw;
  int unasked;
};

// λ is read as warm start and left as the answer; `result` says what it is. `system` is left at the last ε.
class CoulombSolve {
 public:
  CoulombSolve(CoulombSystem& system, Eigen::Ref<VecX> lambda, CoulombWorkspace& ws,
               const CoulombOptions& options, CoulombResult& result) noexcept;
  void run() noexcept;

 private:
  void alternate() noexcept;  // sweeps and Newton in turns
  void polish() noexcept;
  void raise(double epsilon) noexcept;
  void begin(double epsilon) noexcept;
  void take_off_raised() noexcept;
  void sweeps(int length) noexcept;
  void sweep() noexcept;
  bool judge(bool swept) noexcept;
  void keep_in_cones(double* lambda) const noexcept;
  double residual_of(const double* lambda, const double* delta) const noexcept;
  double merit_here() const noexcept;
  void put_back(const double* lambda) noexcept;
  void keep_start() noexcept;
  void take_step(double length) noexcept;

  void newton(const CoulombStage& stage) noexcept;
  double search(double merit) noexcept;

  bool done() const noexcept { return !(result_.residual > tolerance_); }
  bool open() const noexcept {
    return !done() && !hurried_ && result_.sweeps < most_sweeps_ && !options_.deadline.passed();
  }
  bool affords(int factors) const noexcept;  // time for so many LUs like the last one

  CoulombSystem& s_;
  Eigen::Ref<VecX> lambda_;
  CoulombWorkspace& ws_;
  const CoulombOptions& options_;
  CoulombResult& result_;
  int rows_;
  double free_scale_;
  double tolerance_;
  int most_sweeps_;
  int most_newton_;
  double swept_residual_ = 0;
  bool rough_ = false;    // λ is a raw step
  bool hurried_ = false;  // no time for another stage
};

}  // namespace hapticd
