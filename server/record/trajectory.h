// A recorded or scripted motion of a stylus, and its band-limited interpolation.
//
// Positions: natural cubic spline through the samples (C², uneven time stamps). For even stamps of rate f_s
// its frequency response is H(f) = 3 sinc⁴(f/f_s) / (2 + cos(2π f/f_s)): 0.9994 at f_s/8, 0.985 at f_s/4.
// A tone f appears again at f_s − f with H(f_s − f): at 62.5 Hz a 2 Hz motion has an image at 60.5 Hz of
// 1.2e-6, where linear interpolation leaves 1.1e-3 and holding 3.3e-2: neither stair-steps nor corners reach
// the force.
// Orientations: cumulative cubic Bézier curve on the unit quaternions through the samples (C¹), with angular
// velocities at the samples from the parabola through each and its neighbours.
// Buttons: held from their sample on. Before the first and after the last sample: that sample.
// Units: s, m, rad. Errors: make_trajectory throws std::invalid_argument for fewer than two samples or
// times that do not rise; sampling never throws.
// Sources: C. de Boor, A Practical Guide to Splines; M.-J. Kim, M.-S. Kim, S. Y. Shin, "A general
// construction scheme for unit quaternion curves with simple high order derivatives", SIGGRAPH 1995.
#pragma once

#include <cstdint>
#include <vector>

#include "physics/types.h"

namespace hapticd {

struct TrajectorySample {
  double t = 0;  // [s]
  Pose pose;
  std::uint32_t buttons = 0;
};

struct Trajectory {
  std::vector<TrajectorySample> samples;
  std::vector<Vec3> acceleration;      // of the spline, per sample [m/s²]
  std::vector<Vec3> angular_velocity;  // in the body's axes, per sample [rad/s]

  double begin() const { return samples.front().t; }
  double end() const { return samples.back().t; }
};

Trajectory make_trajectory(std::vector<TrajectorySample> samples);

Pose sample_at(const Trajectory& trajectory, double t);
std::uint32_t buttons_at(const Trajectory& trajectory, double t);

}  // namespace hapticd
