#include "tools/chart/tissue/tissue_hertz.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "physics/simulation/world.h"
#include "tests/support/mesh_shapes.h"
#include "tools/chart/tissue/tissue_analytic.h"
#include "tools/chart/tissue/tissue_check.h"

namespace hapticd {
namespace {

constexpr double grading = 5.3;        // β
constexpr double block_in_radii = 60;  // of contact
constexpr double sphere_in_radii = 4;  // how far out the soft sphere's face is round

double contact_radius(double depth) { return std::sqrt(hertz_radius * depth); }

double element_in_radii(int cells) {
  return block_in_radii * std::sinh(2 * grading / cells) / std::sinh(grading);
}

BodySettings half_space(const std::string& name, double depth, int cells, double young, double poisson) {
  BodySettings b;
  b.name = name;
  b.mesh = graded_block(cells, block_in_radii * contact_radius(depth), grading);
  b.material = {young, poisson, 1000, 0, 0};
  b.fixed_nodes = b.mesh.group("bottom")->nodes;
  return b;
}

// The first is pressed by the second in one step.
HertzResult press(BodySettings first, BodySettings second, std::vector<ContactPair> pairs) {
  WorldSettings settings;
  settings.h = 10;  // quasi-static
  settings.alarm_distance = 2e-3;
  settings.sample_spacing = 1e-3;
  settings.coupling[0] = {500, 0.05, 0};
  settings.body_contact.pairs = std::move(pairs);
  Instrument none;
  none.primitives.resize(1);
  none.primitives[0].radius = 1e-3;
  World world({std::move(first), std::move(second)}, std::move(none), settings);
  const auto problem = std::make_unique<CondensedProblem>();
  const StepReport report = world.step([] { return InstrumentSample{}; }, *problem);
  return {world.contacts().force_on(1).z(), 0, report.body_contact.dropped, report.body_contact.penetration};
}

}  // namespace

TetMesh graded_block(int n, double half, double beta) {
  TetMesh mesh = box_mesh({2, 2, 1}, n, n, n / 2);
  for (Vec3& p : mesh.nodes) {
    p -= Vec3(1, 1, 1);
    p = half / std::sinh(beta) * (beta * p.array()).sinh().matrix();
  }
  return mesh;
}

HertzResult hertz_by_bodies(double depth, int cells) {
  // The sphere's lower cap as a plate whose nodes lie on it, `depth` deep.
  const double reach = 2.5 * contact_radius(depth);
  BodySettings cap;
  cap.name = "sphere";
  cap.deformable = false;
  cap.mesh = box_mesh(Vec3(2 * reach, 2 * reach, 1), 60, 60, 1);
  for (Vec3& p : cap.mesh.nodes) {
    p -= Vec3(reach, reach, 0);
    p.z() = p.z() > 0.5 ? 2e-3
                        : hertz_radius - depth -
                              std::sqrt(hertz_radius * hertz_radius - p.x() * p.x() - p.y() * p.y());
  }
  HertzResult result =
      press(half_space("block", depth, cells, hertz_young, hertz_poisson), std::move(cap), {{0, 1, 0}});
  result.element = element_in_radii(cells);
  return result;
}

HertzResult hertz_of_soft_bodies(double depth, int cells, int sphere_cells) {
  BodySettings sphere = half_space("sphere", depth, sphere_cells, soft_sphere_young, soft_sphere_poisson);
  const double a = contact_radius(depth), half = block_in_radii * a;
  for (Vec3& p : sphere.mesh.nodes) {
    p = Vec3(p.x(), -p.y(), -p.z());
    const double r = std::min(p.head<2>().norm(), sphere_in_radii * a);
    p.z() += r * r / (2 * hertz_radius) * (1 - p.z() / half) - depth;
  }
  HertzResult result = press(half_space("block", depth, cells, hertz_young, hertz_poisson), std::move(sphere),
                             {{0, 1, 0}, {1, 0, 0}});
  result.element = element_in_radii(std::min(cells, sphere_cells));
  return result;
}

double hertz_force_of_soft_bodies(double depth) {
  const auto soft = [](double young, double poisson) { return (1 - poisson * poisson) / young; };
  const double together =
      1 / (soft(hertz_young, hertz_poisson) + soft(soft_sphere_young, soft_sphere_poisson));
  return hertz_force(depth, hertz_radius, together, 0);
}

void check_hertz(Effort effort, TissueFindings& findings) {
  constexpr double depth = 25e-6;
  TissueSeries series{"Hertz: force on a rigid sphere", 1, {}, {}};
  HertzResult result;
  const double exact = hertz_force(depth, hertz_radius, hertz_young, hertz_poisson);
  for (const int cells : effort == Effort::quick ? std::vector{16, 24} : std::vector{24, 34, 48}) {
    result = hertz_by_bodies(depth, cells);
    series.size.push_back(result.element);
    series.error.push_back(std::abs(result.force / exact - 1));
  }
  findings.series.push_back(series);
  findings.check("Hertz: force on a rigid sphere, finest mesh [N]", exact, result.force,
                 effort == Effort::quick ? 0.25 : 0.05, "Hertz 1882");
  const double shallow = hertz_by_bodies(0.5 * depth, 20).force, deeper = hertz_by_bodies(depth, 20).force;
  findings.check("Hertz: exponent of the depth", 1.5, std::log2(deeper / shallow), 0.01, "Hertz 1882");
}

}  // namespace hapticd
