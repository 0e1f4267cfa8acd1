// A wall of one fixed sample under a spherical tip: the smallest problem with a hand answer.
//
// The wall is the plane z = height; the tip's centre is the instrument's origin. At depth d below touch
// W = 1/K, so the scene force is K d along +z; within 0.1 %, which is the compliance that rows.h gives
// a fixed obstacle besides the coupling's.
#pragma once

#include <memory>

#include "physics/contact/condensed_problem.h"
#include "physics/contact/instrument.h"

namespace hapticd::wall {

inline constexpr double radius = 0.6e-3;      // [m]
inline constexpr double stiffness = 200;      // K of the coupling [N/m]
inline constexpr double tolerance = 1.1e-3;   // relative, of a force

inline Instrument instrument() {
  Primitive ball;
  ball.name = "tip";
  ball.shape = Shape::sphere;
  ball.radius = radius;
  Instrument tip;
  tip.primitives.push_back(ball);
  return tip;
}

inline void make(CondensedProblem& problem, std::uint64_t step, std::int64_t now_ns, double height = 0) {
  problem.step = step;
  problem.published_ns = now_ns;
  problem.instrument[0].X_ref = {Vec3(0, 0, radius + height), Quat::Identity()};
  problem.renewal = Renewal::renewed;
  problem.topology_changed = problem.thinned = false;
  problem.alarm_distance = 1e-3;
  problem.instrument[0].coupling = {.stiffness = stiffness, .rotational_stiffness = 1};
  problem.nodes = 0;
  problem.samples = 1;
  problem.sample[0] = {.id = 1, .node = {-1, -1, -1}, .weight = {0, 0, 0}, .free = Vec3(0, 0, height),
                       .outward = Vec3(0, 0, 1), .friction = 0};
}

}  // namespace hapticd::wall
