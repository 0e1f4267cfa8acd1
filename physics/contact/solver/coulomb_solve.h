// How the Coulomb solver (coulomb.h) goes about one problem: sweeps and Newton in turns, a
// raised diagonal where they stall, and proximal rounds that take it off again.
//
// coulomb_solve.cpp holds the turns, the rounds, the sweeps and what is judged best; coulomb_descent.cpp the
// steps: newton, search; coulomb_elimination.cpp the steps that eliminate what sticks. Guarantee: wait-free,
// no allocation; bounded by CoulombOptions.
#pragma once

#include "physics/contact/solver/coulomb_newton.h"

namespace hapticd {

constexpr double hyperstatic = 1e-5;  // ratio of a factor's pivots below which freedoms are missing

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
  void eliminate() noexcept;
  bool sort_for_elimination() noexcept;
  bool solve_others(const Deadline& deadline) noexcept;
  void polish() noexcept;
  void raise(double epsilon) noexcept;
  void begin(double epsilon) noexcept;
  void take_off_raised() noexcept;
  void sweeps(int length) noexcept;
  void sweep() noexcept;
  bool judge(bool swept) noexcept;
  void move_into_cones() noexcept;
  double residual_of(const double* lambda, const double* delta) const noexcept;
  double merit_here() const noexcept;
  void put_back(const double* lambda) noexcept;
  void keep_start() noexcept;
  void take_step(double length) noexcept;
  Deadline before_polish() const noexcept;

  void newton(const CoulombStage& stage) noexcept;
  double search(double merit) noexcept;

  bool done() const noexcept { return !(result_.residual > tolerance_); }
  bool open() const noexcept {
    return !done() && !hurried_ && result_.sweeps < most_sweeps_ && !options_.deadline.passed();
  }
  bool may_raise() const noexcept { return s_.epsilon < options_.raised_diagonal; }
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
