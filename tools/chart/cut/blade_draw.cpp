#include "tools/chart/cut/blade_draw.h"

#include <chrono>
#include <cmath>
#include <memory>

#include "physics/simulation/world.h"
#include "tests/support/mesh_shapes.h"
#include "tools/chart/step/drawn_blade.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

constexpr double toughness = 0.5, speed = 10e-3;                                   // J/m², m/s
constexpr double block_x = 24e-3, block_y = 12e-3, block_z = 10e-3, depth = 4e-3;  // m
constexpr double first_x = -3e-3, measured_from = 7e-3, last_x = 15e-3;
constexpr int samples = 16, samples_above = 4;

}  // namespace

BladeDraw draw_blade(double h, int cells) {
  const double cell = block_z / cells;
  BodySettings block{"block",
                     true,
                     box_mesh({block_x, block_y, block_z}, static_cast<int>(std::lround(block_x / cell)),
                              static_cast<int>(std::lround(block_y / cell)), cells, 5),
                     {20000, 0.4, 1000, 5, 0.002},
                     {},
                     0,
                     false};
  block.fixed_nodes = block.mesh.group("bottom")->nodes;
  block.toughness = toughness;
  const int nodes = static_cast<int>(block.mesh.nodes.size());
  block.room = {4 * nodes, 20 * nodes};
  WorldSettings settings;
  settings.h = h;
  settings.alarm_distance = 2e-3;
  settings.sample_spacing = 1e-3;
  settings.coupling[0] = {500, 0.05, 0};
  constexpr double width = depth / (samples - samples_above);
  World world({block}, sheet_blade(samples * width, samples), settings);

  BladeDraw out;
  out.h_ms = 1e3 * h;
  out.mesh = cells;
  out.expected_n = toughness * depth;
  // A quarter of a sample low: the block's top bulges by less than what is then left to the next sample.
  const double edge_middle = block_z - depth + (0.5 * samples - 0.25) * width;
  auto problem = std::make_unique<CondensedProblem>();
  double sum = 0, squares = 0, area_before = 0, energy_before = 0;
  std::vector<double> ms;
  int measured = 0;
  const auto energy = [&] { return elastic_energy(world.bodies()[0].model, world.bodies()[0].state); };
  for (double x = first_x; x < last_x; x += speed * h) {
    const InstrumentSample sample{
        {Vec3(x, block_y / 2 + 0.13e-3, edge_middle), Quat::Identity()}, true, false, false};
    const auto begin = std::chrono::steady_clock::now();
    const StepReport report = world.step([&] { return InstrumentSamples(sample); }, *problem);
    ms.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count());
    ++out.steps;
    out.split_steps += report.split;
    if (x < measured_from) {
      area_before = world.cutting().area();
      energy_before = energy();
      continue;
    }
    const double force = -report.contact.wrench[0].x();
    sum += force;
    squares += force * force;
    out.work_j += force * speed * h;
    ++measured;
  }
  out.force_n = sum / measured;
  out.force_deviation_n = std::sqrt(std::max(0.0, squares / measured - out.force_n * out.force_n));
  out.area_m2 = world.cutting().area() - area_before;
  out.released_j = toughness * out.area_m2;
  out.elastic_j = energy() - energy_before;
  out.nodes_added = world.bodies()[0].model.nodes_in_use - nodes;
  out.step_ms_p99 = quantiles(ms).p99;
  return out;
}

}  // namespace hapticd
