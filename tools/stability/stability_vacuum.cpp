// Mode `vacuum`: a port draws tissue, holds it, and lets go of it.
//
// A needle with a flat end, its port in that end, is pressed onto the cube's top. The pump is switched on
// (the port is covered), the needle is lifted, with tissue on it, the pump is switched off, and on again
// within the port's reach, so that the tissue is drawn across the gap; then the hand pulls the needle off.
// Whenever the pump has come to rest, the hand must be at rest.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "tools/stability/bench/largest_stiffness.h"
#include "tools/stability/bench/procedure.h"
#include "tools/stability/stability_plans.h"

namespace hapticd {
namespace {

constexpr double top = 20e-3, above = 2e-3;  // the cube's, and where the needle begins [m]
constexpr double needle_radius = 3e-3, port_radius = 2e-3, reach = 1e-3;  // [m]
constexpr double deep = 0.5e-3, lifted = 0.25e-3, off = 6e-3;             // [m]
constexpr double moves = 0.4, stays = 0.5;                                // [s]
constexpr double punch = 38;  // of the cube under the needle, 2 a E/(1 − ν²) [N/m]
constexpr double rises = 7;   // time constants that a pump takes to come to rest

struct Pump {
  double vacuum, rise_time, rate;  // [Pa], [s], of the simulation [Hz]
};

Procedure procedure_of(const StabilityBench& bench, const Pump& pump, double lead) {
  Procedure o;
  o.scene = bench.scene();
  o.scene.rate = pump.rate;
  o.scene.sample_spacing = light_spacing;
  SceneInstrument& held = o.scene.first();
  Primitive needle;
  needle.name = "needle";
  needle.shape = Shape::cylinder;
  needle.radius = needle_radius;
  needle.half_length = 20e-3;
  needle.placement.p = Vec3(0, 0, needle.half_length);
  held.shape = {};
  held.shape.primitives = {needle};
  held.shape.port = {Vec3::Zero(), -Vec3::UnitZ(), port_radius, reach, pump.vacuum, pump.rise_time};
  o.grip = bench.press().hand;
  as_on_a_touch(o);
  // When each part begins.
  const double settles = stays + rises * pump.rise_time;
  const double pressed = moves, drawn = pressed + stays, lifts = drawn + settles,
               vents = lifts + moves + stays, again = vents + settles, pulls = again + settles,
               ends = pulls + moves + stays;
  const double pull = pump.vacuum * std::numbers::pi * port_radius * port_radius;
  ProcedureHand hand;
  hand.at = [=](double t) -> Vec3 {
    const double down = smooth_step(t / moves), up = smooth_step((t - lifts) / moves),
                 away = smooth_step((t - pulls) / moves);
    double z = above - (above + lead * deep) * down + lead * (deep + lifted) * up;
    z += away * (off + lead * 1.5 * pull / punch);
    return Vec3(0, 0, top + z);
  };
  hand.pedals = [=](double t) -> std::uint32_t {
    return (t >= drawn && t < vents) || t >= again ? pedal_aspiration : 0u;
  };
  o.hands = {hand};
  o.duration = ends;
  o.rests = {{drawn - 0.2, drawn}, {lifts - 0.2, lifts}, {vents - 0.2, vents},
             {again - 0.2, again}, {pulls - 0.2, pulls}, {ends - 0.2, ends}};
  o.loading = {0, pressed};
  return o;
}

}  // namespace

StabilityPlan plan_vacuum(StabilityBench& bench, bool quick) {
  std::vector<ProcedureWay> ways;
  for (const Pump& pump :
       {Pump{1500, 0.1, 50}, Pump{500, 0.1, 50}, Pump{4500, 0.1, 50}, Pump{1500, 0, 50}, Pump{4500, 0, 50},
        Pump{1500, 0.5, 50}, Pump{1500, 0.1, 25}, Pump{1500, 0.1, 100}, Pump{4500, 0, 25}}) {
    if (quick && !ways.empty()) break;
    char name[80];
    std::snprintf(name, sizeof name, "%.0f Pa, rising in %.1f s, %.0f Hz", pump.vacuum, pump.rise_time,
                  pump.rate);
    ways.push_back({name, [&bench, pump](double lead) { return procedure_of(bench, pump, lead); }});
  }
  StabilityPlan plan = procedure_plan(std::move(ways), quick);
  plan.parameter = "displayed stiffness [N/m] of a cube that a port is pressed on, draws, and is pulled off";
  return plan;
}

}  // namespace hapticd
