// Worlds of bodies that rub on one another, whose answers one can write down: a block on another, an incline,
// a wedge.
//
// All step by 20 ms. Units: SI.
#pragma once

#include "tests/support/bodies.h"

namespace hapticd {

// A floating block, [2, 10] × [2, 10] mm, on one that is held, [0, 12] × [0, 12] mm, 6 mm high; both soft,
// the upper's top at 10 mm; a ball of 2 mm.
struct BlockOnBlock {
  double mu = 0;
  bool gravity = true, contacts = true;
  double apart = 1e-5;  // [m]
};
std::unique_ptr<World> block_on_block(const BlockOnBlock& settings);

// A soft block [10, 10, 5] mm on an incline of this angle, gravity downwards: it sticks while tan(angle) ≤ μ.
struct Incline {
  std::unique_ptr<World> world;
  CondensedProblem problem;
  Vec3 down;  // along the fall line

  Incline(double angle, double mu, bool soft_ground = false, const std::array<int, 3>& cells = {5, 5, 3});
  StepReport step();
  const Body& body() const { return world->bodies()[0]; }
  double speed() const;  // down the fall line [m/s]
};

// A soft wedge of this half angle α, pressed by a ball between two rigid walls in the first 70 of its steps,
// then let go: it stays while tan α < μ.
struct Wedge {
  static constexpr int steps = 150;
  std::unique_ptr<World> world;
  double pressed = 0, applied = 0;  // the most that a wall bore, and the ball's force then [N]

  Wedge(double half_angle, double mu, const std::array<int, 3>& cells = {4, 3, 4});
  StepReport step();
  Vec3 on_wall(int side) const;  // 0: at −x, 1: at +x [N]

  // Of `pressed` over `applied` while all of it slides in: each wall gives N (sin α + μ cos α) against half
  // the load, and N √(1 + μ²) in all. What is stuck may give more.
  double sliding_in() const;

 private:
  double alpha_, mu_;
  int done_ = 0;
  std::unique_ptr<CondensedProblem> problem_ = std::make_unique<CondensedProblem>();
};

}  // namespace hapticd
