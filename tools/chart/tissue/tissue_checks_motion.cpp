// Motion by the product's own step: what it keeps exactly, and what implicit Euler loses, in proportion to h.
#include <cmath>
#include <string>

#include <algorithm>

#include "physics/simulation/body.h"
#include "tests/support/mesh_shapes.h"
#include "tools/chart/tissue/tissue_check.h"

namespace hapticd {

namespace {

struct Sums {
  Vec3 momentum = Vec3::Zero();
  Vec3 spin = Vec3::Zero();
  double energy = 0;  // kinetic and elastic
};

Sums sums_of(const Body& body) {
  Sums s;
  for (int n = 0; n < body.model.node_count(); ++n) {
    const Vec3 p = body.state.mass[n] * body.state.v[n];
    s.momentum += p;
    s.spin += body.state.x[n].cross(p);
    s.energy += 0.5 * p.dot(body.state.v[n]);
  }
  s.energy += elastic_energy(body.model, body.state);
  return s;
}

// A floating block that flies, spins and is stretched, in steps of h up to `time`.
struct Flight {
  Sums before, after;
  double momentum_drift = 0;  // largest, relative
  double energy_gain = 0;     // largest of one step, relative; below zero where it always falls
};

Flight fly(double h, double time, const Vec3& turn, const Vec3& gravity) {
  const Vec3 size(1e-2, 1e-2, 1e-2);
  BodySettings settings;
  settings.mesh = box_mesh(size, 4, 4, 4);
  jitter_interior(settings.mesh, size, 5e-4, 3);
  settings.material = {3000, 0.45, 1000, 0, 0};
  Body body(std::move(settings), h, gravity);
  const Vec3 centre = 0.5 * size, velocity(0.3, -0.2, 0.1);
  for (int n = 0; n < body.model.node_count(); ++n) {
    const Vec3 r = body.state.x[n] - centre;
    body.state.v[n] = velocity + turn.cross(r);
    body.state.x[n] += 0.05 * Vec3(r.x(), -0.5 * r.y(), -0.5 * r.z());
  }
  update_rotations(body.model, body.state);
  Flight flight;
  flight.before = sums_of(body);
  flight.energy_gain = -1;
  double energy = flight.before.energy;
  const int steps = static_cast<int>(std::lround(time / h));
  for (int k = 0; k < steps; ++k) {
    body.compliance->update(body.state);
    compute_free_motion(body, h);
    correct(body, nullptr, h);
    update_rotations(body.model, body.state);
    flight.after = sums_of(body);
    const double mass = 1000 * size.prod();
    const Vec3 expected = flight.before.momentum + (k + 1) * h * mass * gravity;
    flight.momentum_drift = std::max(
        flight.momentum_drift, (flight.after.momentum - expected).norm() / flight.before.momentum.norm());
    flight.energy_gain = std::max(flight.energy_gain, flight.after.energy / energy - 1);
    energy = flight.after.energy;
  }
  return flight;
}

}  // namespace

void check_motion(Effort effort, TissueFindings& findings) {
  const double time = effort == Effort::quick ? 2 : 20;
  const Flight straight = fly(0.02, time, Vec3::Zero(), Vec3::Zero());
  const Flight turning = fly(0.02, time, Vec3(1, 2, -1.5), Vec3::Zero());
  const char* newton = "Newton's laws";
  findings.check("free flight at 50 Hz, spinning: momentum", 0, turning.momentum_drift, 1e-9, newton);
  const char* gives = "implicit Euler takes energy and never gives";
  findings.check("free flight at 50 Hz, no spin: energy gained in any one step", 0,
                 std::max(0.0, straight.energy_gain), 1e-12, gives);
  // A step solves once: a turn within it stretches the body by 1 − cos.
  findings.check("free flight at 50 Hz, 0.05 rad a step: energy gained in any one step", 0,
                 std::max(0.0, turning.energy_gain), 1e-5, gives);
  findings.check("free fall at 50 Hz: momentum against m g t", 0,
                 fly(0.02, 0.4, Vec3::Zero(), Vec3(0, 0, -9.81)).momentum_drift, 1e-9, newton);

  TissueSeries energy{"free flight: energy lost in 10 ms, against h", 1, {}, {}};
  TissueSeries spin{"free flight: spin lost in 10 ms, against h", 1, {}, {}};
  for (const double h : {2e-5, 1e-5, 5e-6}) {
    const Flight flight = fly(h, 0.01, Vec3(10, 20, -15), Vec3::Zero());
    energy.size.push_back(h);
    energy.error.push_back(1 - flight.after.energy / flight.before.energy);
    spin.size.push_back(h);
    spin.error.push_back((flight.after.spin - flight.before.spin).norm() / flight.before.spin.norm());
  }
  const char* euler = "implicit Euler: first order";
  findings.converges(energy, 0.1, euler);
  findings.converges(spin, 0.1, euler);
}

}  // namespace hapticd
