// Modes of a blade: pressed below and at the force at which it cuts.
//
// A level edge, wider than a block of the cube's tissue, with a sheet above it, comes down on the block's
// middle. J w is the force at which it cuts; K, how stiff the block is against the edge below that, is from
// one slow press.
#include <algorithm>
#include <cmath>

#include "tests/support/mesh_shapes.h"
#include "tools/stability/stability_plans.h"

namespace hapticd {
namespace {

constexpr double width = 6e-3, edge_length = 8e-3, toughness = 4;  // of the block across [m]; J [J/m²]
constexpr double limit = toughness * width;                        // J w [N]
constexpr double above = 1e-3;                                     // where presses begin [m]
constexpr int edge_samples = 16;
constexpr double least_scale = 1e-6;

// Its top is at z = 0, the blade's edge above its middle.
Scene blade_scene(const StabilityBench& bench) {
  Scene scene = bench.scene();
  scene.alarm_distance = 2e-3;
  scene.sample_spacing = 1e-3;
  SceneBody& body = scene.bodies.front();
  constexpr double length = 12e-3, thickness = 6e-3;
  body.mesh = box_mesh(Vec3(length, width, thickness), 8, 4, 4, 5);
  body.fixed_nodes.clear();
  for (int n = 0; n < static_cast<int>(body.mesh.nodes.size()); ++n) {
    Vec3& x = body.mesh.nodes[static_cast<std::size_t>(n)];
    if (x.z() == 0) body.fixed_nodes.push_back(n);
    x -= Vec3(0.5 * length - 0.1e-3, 0.5 * width, thickness);
  }
  body.removable = false;
  body.toughness = toughness;
  body.max_new_nodes = 800;
  Instrument& knife = scene.first().shape;
  knife = {};
  knife.blade =
      make_blade({Vec3(0, -edge_length / 2, 0), Vec3(0, edge_length / 2, 0)}, Vec3(0, 0, -1), edge_samples);
  std::vector<Vec3> corners;
  for (const double x : {-0.05e-3, 0.05e-3})
    for (const double y : {-edge_length / 2, edge_length / 2})
      for (const double z : {2e-3, 12e-3}) corners.emplace_back(x, y, z);
  knife.primitives = {make_convex("sheet", corners, {})};
  return scene;
}

// Presses that end so deep in the block.
ClosedLoopSettings press_to(const StabilityBench& bench, double depth, double deeper) {
  ClosedLoopSettings s = bench.press();
  s.press.start = Vec3(0, 0, above);
  s.press.depth = above + depth;
  s.deeper = deeper;
  return s;
}

// What the block is like below the limit.
struct Block {
  double stiffness = 0;  // K [N/m]
  double gives = 0;      // how far the edge is below the block's top at half the limit [m]
};

Block press_slowly(const StabilityBench& knife) {
  ClosedLoopSettings s = press_to(knife, 3e-3, 1e-6);
  s.press.speed = 2e-3;
  s.press.hold = 0.1;
  s.hand.quantum = 0;
  const std::vector<ClosedLoopTick> slow = knife.daemon(least_scale, s).ticks;
  Block block;
  block.stiffness = slope_at(slow, least_scale, 0.5 * limit);
  for (const ClosedLoopTick& tick : slow)
    if (tick.force < 0.5 * limit * least_scale)
      block.gives = tick.depth - above;
    else
      break;
  return block;
}

// share: of the limit that the hand presses with in the first hold, and how deep the edge then is in the cut.
StabilityPlan pressed(StabilityBench& bench, bool quick, double share, double cut, double deeper) {
  StabilityPlan plan;
  plan.naive = "contact force held for the 20 ms of a simulation step";
  plan.ours = "the daemon";
  plan.judged = "swing at rest beyond two quanta [µm]";
  plan.limit = swing_limit_um;
  plan.reason = "100 N/m: as of the modes of time";
  plan.required = 100;
  plan.values = quick ? std::vector<double>{100, 1600} : geometric(25, 25600, 2);
  const StabilityBench knife(blade_scene(bench));
  const Block block = press_slowly(knife);
  const auto run = [=](double displayed, Rendering rendering) {
    const double scale = displayed / block.stiffness;
    const double pressed_with = scale * share * limit;
    // A hand's spring is as long as its force wants beyond where the edge is.
    const double depth = 2 * share * block.gives + cut + pressed_with / knife.press().hand.stiffness;
    DaemonRendererOptions options;
    options.rendering = rendering;
    const ClosedLoopSettings s =
        press_to(knife, depth, deeper * (1 + displayed / knife.press().hand.stiffness));
    return by_swing(knife.daemon(scale, s, options), s.hand);
  };
  plan.run_naive = [run](double displayed) { return run(displayed, Rendering::held); };
  plan.run_ours = [run](double displayed) { return run(displayed, Rendering::solved); };
  return plan;
}

}  // namespace

StabilityPlan plan_blade_below(StabilityBench& bench, bool quick) {
  StabilityPlan plan = pressed(bench, quick, 0.5, 0, 0.1e-3);
  plan.parameter = "displayed stiffness [N/m] of a block that a blade presses with half of what it cuts with";
  return plan;
}

StabilityPlan plan_blade_at(StabilityBench& bench, bool quick) {
  StabilityPlan plan = pressed(bench, quick, 1, 1.5e-3, 0.3e-3);
  plan.parameter =
      "displayed stiffness [N/m] of a block in which a blade comes to rest at the force it cuts with";
  return plan;
}

}  // namespace hapticd
