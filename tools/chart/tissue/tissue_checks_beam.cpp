// Beams: cantilever, elastica, torsion, frequencies. ν = 0 where a support would otherwise pinch.
#include <cmath>
#include <numbers>

#include "tests/support/mesh_shapes.h"
#include "tools/chart/tissue/tissue_analytic.h"
#include "tools/chart/tissue/tissue_check.h"
#include "tools/chart/tissue/tissue_static.h"

namespace hapticd {

namespace {

constexpr double young = 1e6, density = 1000, height = 1e-2;
constexpr double tiny = 1e-9;

// A strip along x, one cell wide and `n` high, that only moves in its own plane: for ν = 0, exactly a beam.
struct Strip {
  TissueModel model;
  Held held;
  Beam beam;
};

Strip strip(double length, int n) {
  const double width = height / n;
  const int along = static_cast<int>(std::lround(length / height)) * n;
  Strip s{make_tissue_model(box_mesh({length, width, height}, along, 1, n), {young, 0, density, 0, 0}, {},
                            Vec3::Zero()),
          {},
          rectangular_beam(length, width, height, young, density)};
  for (int axis = 0; axis < 3; ++axis)
    hold(
        s.model, axis, [&](const Vec3& x) { return axis == 1 || x.x() < tiny; }, s.held);
  return s;
}

// The load as a traction that goes to zero at the edges, as the shear does.
VecX tip_load(const Strip& s, double force) {
  const double end = s.beam.length - tiny;
  VecX f = surface_load(s.model, Vec3(0, 0, -1), [&](const Vec3& x) { return x.x() > end; });
  for (int n = 0; n < s.model.node_count(); ++n) {
    const double z = s.model.mesh.nodes[n].z() / height;
    f[3 * n + 2] *= z * (1 - z);
  }
  return f * (force / -f.sum());
}

// Mean over the end of the strip.
Vec3 tip_of(const Strip& s, const VecX& u) {
  Vec3 sum = Vec3::Zero();
  int count = 0;
  for (int n = 0; n < s.model.node_count(); ++n)
    if (s.model.mesh.nodes[n].x() > s.beam.length - tiny) {
      sum += u.segment<3>(3 * n);
      ++count;
    }
  return sum / count;
}

std::vector<int> refinements(Effort effort, std::vector<int> quick, std::vector<int> full) {
  return effort == Effort::quick ? quick : full;
}

}  // namespace

void check_cantilever(Effort effort, TissueFindings& findings) {
  const double length = 10 * height;
  TissueSeries series{"cantilever, small: tip", 2, {}, {}};
  double relative[2] = {0, 0};
  for (const int n : refinements(effort, {8, 16}, {4, 8, 16, 32})) {
    const Strip s = strip(length, n);
    const double force = 1e-6 * s.beam.bending / (length * length);
    const double value =
        -tip_of(s, solve_linear(s.model, tip_load(s, force), s.held)).z() / timoshenko_tip(s.beam, force);
    series.size.push_back(1.0 / n);
    series.error.push_back(std::abs(value - 1));
    relative[0] = relative[1];
    relative[1] = value;
  }
  const char* source = "Timoshenko 1921: PL³/3EI + PL/κGA";
  findings.converges(series, 0.15, source);
  findings.check("cantilever, small: tip over the beam's, extrapolated (order 2)", 1,
                 extrapolated(relative[0], relative[1], 2, 2), effort == Effort::quick ? 1e-2 : 2e-3, source);
  findings.check("cantilever, small: tip over the beam's, finest mesh", 1, relative[1],
                 effort == Effort::quick ? 2e-2 : 5e-3, source);
}

void check_elastica(Effort effort, TissueFindings& findings) {
  const double length = 20 * height, factor = 5;
  const Beam inextensible{1, 1, 1e12, 1e12, 0};
  const char* table = "Bisshopp and Drucker 1945, Mattiasson 1981";
  findings.check("elastica, PL²/EI = 5: the reference's sinking", 0.71379,
                 elastica_tip(inextensible, 5).sinking, 1e-5, table);
  findings.check("elastica, PL²/EI = 5: the reference's shortening", 0.38763,
                 elastica_tip(inextensible, 5).shortening, 1e-5, table);
  TissueSeries series{"cantilever, large: tip", 2, {}, {}};
  Vec3 tip[2] = {Vec3::Zero(), Vec3::Zero()};
  TipPlace exact{};
  for (const int n : refinements(effort, {4, 8}, {4, 8, 16})) {
    const Strip s = strip(length, n);
    const double force = factor * s.beam.bending / (length * length);
    const LargeSolution solved = solve_large(s.model, tip_load(s, force), s.held, 4);
    VecX u(3 * s.model.node_count());
    for (int k = 0; k < s.model.node_count(); ++k)
      u.segment<3>(3 * k) = solved.state.x[k] - s.model.mesh.nodes[k];
    exact = elastica_tip(s.beam, force);
    tip[0] = tip[1];
    tip[1] = tip_of(s, u);
    series.size.push_back(1.0 / n);
    series.error.push_back(std::hypot(tip[1].x() + exact.shortening, tip[1].z() + exact.sinking) / length);
  }
  const char* source = "Reissner 1972: the elastica with shear and extension";
  const double tolerance = effort == Effort::quick ? 3e-2 : 5e-3;
  findings.converges(series, effort == Effort::quick ? 0.3 : 0.15, source);
  findings.check("cantilever, large: sinking over L, extrapolated (order 2)", exact.sinking / length,
                 extrapolated(-tip[0].z(), -tip[1].z(), 2, 2) / length, tolerance, source);
  findings.check("cantilever, large: shortening over L, extrapolated (order 2)", exact.shortening / length,
                 extrapolated(-tip[0].x(), -tip[1].x(), 2, 2) / length, tolerance, source);
}

void check_torsion(Effort effort, TissueFindings& findings) {
  const double side = 1e-2, length = 0.5e-2, twist = 1e-3, nu = 0.3;
  TissueSeries series{"torsion of a square bar: stiffness", 2, {}, {}};
  double stiffness[2] = {0, 0};
  for (const int n : refinements(effort, {6, 12}, {6, 12, 24})) {
    const TissueModel model = make_tissue_model(box_mesh({side, side, length}, n, n, n / 2),
                                                {young, nu, density, 0, 0}, {}, Vec3::Zero());
    // The ends turn as discs and are free to warp: Saint-Venant's own solution.
    Held held;
    for (int k = 0; k < model.node_count(); ++k) {
      const Vec3& x = model.mesh.nodes[k];
      if (x.z() > tiny && x.z() < length - tiny) continue;
      const double angle = x.z() > tiny ? twist : 0;
      held[3 * k] = -angle * (x.y() - 0.5 * side);
      held[3 * k + 1] = angle * (x.x() - 0.5 * side);
    }
    held[2] = 0;
    const VecX u = solve_linear(model, VecX::Zero(3 * model.node_count()), held);
    const double energy = 0.5 * u.dot(stiffness_at_rest(model) * u);
    stiffness[0] = stiffness[1];
    stiffness[1] = 2 * energy / (twist * twist) * length / (model.material.mu() * std::pow(side, 4));
    series.size.push_back(1.0 / n);
    series.error.push_back(std::abs(stiffness[1] / square_torsion() - 1));
  }
  const char* source = "Saint-Venant 1855: 0.140577 G a⁴";
  findings.converges(series, 0.1, source);
  findings.check("torsion of a square bar: stiffness over G a⁴, extrapolated (order 2)", square_torsion(),
                 extrapolated(stiffness[0], stiffness[1], 2, 2), effort == Effort::quick ? 5e-3 : 1e-3,
                 source);
}

void check_frequencies(Effort effort, TissueFindings& findings) {
  const double length = 10 * height;
  const double hz = 1 / (2 * std::numbers::pi);
  TissueSeries series{"beam: first bending frequency", 2, {}, {}};
  double bending[2] = {0, 0};
  double exact = 0, axial = 0;
  for (const int n : refinements(effort, {8, 16}, {4, 8, 16, 32})) {
    Strip s = strip(length, n);
    const double rotary = s.beam.mass * height * height / 12;
    exact = hz * timoshenko_frequency(s.beam, rotary);
    bending[0] = bending[1];
    bending[1] = hz * lowest_frequency(s.model, s.held);
    series.size.push_back(1.0 / n);
    series.error.push_back(std::abs(bending[1] / exact - 1));
    hold(
        s.model, 2, [](const Vec3&) { return true; }, s.held);
    axial = hz * lowest_frequency(s.model, s.held);
  }
  const char* source = "Timoshenko 1921: shear and rotary inertia";
  findings.converges(series, 0.15, source);
  findings.check("beam: first bending frequency, extrapolated (order 2) [Hz]", exact,
                 extrapolated(bending[0], bending[1], 2, 2), effort == Effort::quick ? 1e-2 : 2e-3, source);
  findings.check("bar: first axial frequency [Hz]", std::sqrt(young / density) / (4 * length), axial, 1e-3,
                 "d'Alembert: √(E/ρ)/4L");
}

}  // namespace hapticd
