// A needle with a port in its flat end, and a sheet to draw on. Units: SI.
#pragma once

#include <memory>
#include <numbers>

#include "physics/contact/condensed_problem.h"
#include "physics/contact/instrument.h"

namespace hapticd::suction {

inline constexpr double port_radius = 0.5e-3, vacuum = 1e3,
                        port_area = std::numbers::pi * port_radius * port_radius;

// A needle with a flat end at its origin, and the port in that end.
inline Instrument needle() {
  Primitive shaft;
  shaft.shape = Shape::cylinder;
  shaft.radius = 0.8e-3;
  shaft.half_length = 2e-3;
  shaft.placement.p = Vec3(0, 0, 2e-3);
  Instrument instrument;
  instrument.primitives = {shaft};
  instrument.port = {Vec3::Zero(), -Vec3::UnitZ(), port_radius, 0.3e-3, vacuum, 0.3};
  return instrument;
}

// A square sheet of 2 n² faces at this height, nine samples a face.
inline std::unique_ptr<CondensedProblem> sheet(double side, int n, double height) {
  auto problem = std::make_unique<CondensedProblem>();
  CondensedProblem& p = *problem;
  const auto node = [&](int i, int j) { return static_cast<std::int32_t>(i * (n + 1) + j); };
  p.nodes = (n + 1) * (n + 1);
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j <= n; ++j)
      p.x_free[node(i, j)] = Vec3(side * i / n - side / 2, side * j / n - side / 2, height);
  p.x_now = p.x_free;
  p.C().setZero();
  std::uint64_t face = 0;
  const auto add = [&](std::int32_t a, std::int32_t b, std::int32_t c) {
    for (int k = 0; k < 9; ++k) {
      const double u = (k % 3 + 0.5) / 4, v = (k / 3 + 0.5) / 4;
      p.sample[p.samples++] = {face * 4096 + static_cast<std::uint64_t>(k),
                               {a, b, c},
                               {1 - u - v, u, v},
                               Vec3::Zero(),
                               Vec3::UnitZ(),
                               0};
    }
    ++face;
  };
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      add(node(i, j), node(i + 1, j), node(i + 1, j + 1));
      add(node(i, j), node(i + 1, j + 1), node(i, j + 1));
    }
  return problem;
}

}  // namespace hapticd::suction
