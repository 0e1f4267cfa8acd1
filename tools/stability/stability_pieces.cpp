// Modes of pieces: two hands crack tissue along a cleft, the last bridge of a piece goes under a hand, and
// two hands hold a piece between them.
#include <algorithm>
#include <cmath>

#include "tests/support/mesh_shapes.h"
#include "tools/stability/bench/largest_stiffness.h"
#include "tools/stability/bench/procedure.h"
#include "tools/stability/stability_plans.h"

namespace hapticd {
namespace {

constexpr double tip_radius = 2e-3, stick_radius = 1.2e-3, stick_length = 40e-3;  // [m]
constexpr double moves = 0.5, stays = 0.5, looked = 0.2;                          // [s]
constexpr double friction = 0.3;

Instrument ball_on_a_stick(const Vec3& way) {
  Primitive tip, stick;
  tip.name = "tip";
  tip.shape = Shape::sphere;
  tip.radius = tip_radius;
  stick.name = "stick";
  stick.shape = Shape::cylinder;
  stick.radius = stick_radius;
  stick.half_length = 0.5 * stick_length;
  stick.placement = {0.5 * stick_length * way, Quat::FromTwoVectors(Vec3::UnitZ(), way)};
  Instrument instrument;
  instrument.primitives = {tip, stick};
  return instrument;
}

// The cube's tissue in another shape, and an instrument for each hand.
Procedure procedure_on(const StabilityBench& bench, TetMesh mesh,
                       const std::vector<Instrument>& instruments) {
  Procedure o;
  o.scene = bench.scene();
  o.scene.sample_spacing = light_spacing;
  SceneBody& body = o.scene.bodies.front();
  body.mesh = std::move(mesh);
  body.fixed_nodes.clear();
  body.friction = friction;
  o.scene.instruments.resize(1);
  o.scene.instruments.resize(instruments.size(), o.scene.first());
  for (std::size_t i = 0; i < instruments.size(); ++i) {
    o.scene.instruments[i].name = i == 0 ? "first" : "second";
    o.scene.instruments[i].shape = instruments[i];
  }
  o.grip = bench.press().hand;
  as_on_a_touch(o);
  return o;
}

Vec3 middle_of(const TetMesh& mesh, std::size_t t) {
  Vec3 x = Vec3::Zero();
  for (const int n : mesh.tets[t]) x += 0.25 * mesh.nodes[static_cast<std::size_t>(n)];
  return x;
}

// Without the tetrahedra of which `goes` says so, and without nodes that then have none.
template <class Goes>
TetMesh without(const TetMesh& whole, const Goes& goes) {
  TetMesh left;
  std::vector<int> number(whole.nodes.size(), -1);
  for (std::size_t t = 0; t < whole.tets.size(); ++t) {
    if (goes(middle_of(whole, t))) continue;
    Tet tet = whole.tets[t];
    for (int& n : tet) {
      int& as = number[static_cast<std::size_t>(n)];
      if (as < 0) {
        as = static_cast<int>(left.nodes.size());
        left.nodes.push_back(whole.nodes[static_cast<std::size_t>(n)]);
      }
      n = as;
    }
    left.tets.push_back(tet);
  }
  return left;
}

// Springs on nodes at the bottom, of this stiffness together.
void hold_by_springs(SceneBody& body, double stiffness, double up_to) {
  int held = 0;
  for (const Vec3& x : body.mesh.nodes) held += x.z() <= up_to;
  body.springs.clear();
  for (const Vec3& x : body.mesh.nodes) body.springs.push_back({x.z() <= up_to ? stiffness / held : 0, x});
}

// Faces all of whose nodes are in the plane x[axis] = at part where they are stretched by what toughness
// says.
void tears_at(SceneBody& body, int axis, double at, double toughness) {
  body.toughness = body.tearing.toughness = toughness;
  body.max_new_nodes = 100;
  body.tearing.begins = true;
  body.tearing.clefts.assign(4 * body.mesh.tets.size(), 0);
  for (std::size_t id = 0; id < body.tearing.clefts.size(); ++id) {
    const Triangle n = outward_face(body.mesh.tets[id / 4], static_cast<int>(id % 4));
    body.tearing.clefts[id] = std::all_of(n.begin(), n.end(), [&](int k) {
      return std::abs(body.mesh.nodes[static_cast<std::size_t>(k)][axis] - at) < 1e-9;
    });
  }
}

// There and, from `back` on, back again: 1 while there.
double there_and_back(double t, double takes, double back) {
  return smooth_step(t / takes) - smooth_step((t - back) / takes);
}

// A groove, two balls side by side in it, each against a wall, which it pushes this far.
Procedure crack(const StabilityBench& bench, double toughness, double takes, double apart, double lead) {
  constexpr double length = 24e-3, width = 12e-3, height = 8e-3, groove = 6e-3, bridge = 3.2e-3;
  constexpr double aside = 3e-3, free = 0.5 * groove - tip_radius - 0.2e-3;
  const TetMesh block = box_mesh(Vec3(length, width, height), 8, 4, 5);
  Procedure o = procedure_on(
      bench,
      without(block,
              [](const Vec3& x) { return std::abs(x.x() - 0.5 * length) < 0.5 * groove && x.z() > bridge; }),
      {ball_on_a_stick(Vec3::UnitZ()), ball_on_a_stick(Vec3::UnitZ())});
  SceneBody& body = o.scene.bodies.front();
  hold_by_springs(body, 60, 0);
  tears_at(body, 0, 0.5 * length, toughness);
  const double back = takes + stays, ends = back + takes + stays;
  for (const double side : {-1.0, 1.0})
    o.hands.push_back({[=](double t) -> Vec3 {
      return Vec3(0.5 * length + side * (free + lead * apart * there_and_back(t, takes, back)),
                  0.5 * width + side * aside, bridge + tip_radius + 0.6e-3);
    }});
  o.duration = ends;
  o.rests = {{back - looked, back}, {ends - looked, ends}};
  o.along = -Vec3::UnitX();
  o.loading = {0, takes};
  return o;
}

enum class Bridge { pressed, aside, torn, drawn };

// A piece on a neck; a hand presses on it, pushes it aside, or draws at it, and the neck goes.
Procedure last_bridge(const StabilityBench& bench, Bridge way, double lead) {
  constexpr double size = 12e-3, cell = 2e-3, low = 4e-3, high = 6e-3;
  const auto in_neck = [](const Vec3& x) {
    return std::max(std::abs(x.x() - 0.5 * size), std::abs(x.y() - 0.5 * size)) < cell;
  };
  const TetMesh block = box_mesh(Vec3(size, size, size), 6, 6, 6);
  const TetMesh mesh =
      without(block, [&](const Vec3& x) { return x.z() > low && x.z() < high && !in_neck(x); });
  Instrument tip = ball_on_a_stick(Vec3::UnitZ());
  if (way == Bridge::drawn) {
    tip.primitives.erase(tip.primitives.begin());
    tip.primitives[0].radius = tip_radius;
    tip.port = {Vec3::Zero(), -Vec3::UnitZ(), 1.5e-3, 1e-3, 1500, 0.05};
  }
  Procedure o = procedure_on(bench, mesh, {tip});
  SceneBody& body = o.scene.bodies.front();
  for (std::size_t n = 0; n < mesh.nodes.size(); ++n)
    if (mesh.nodes[n].z() == 0) body.fixed_nodes.push_back(static_cast<int>(n));
  constexpr double begins = 1.2, every = 0.04, goes_for = 0.6;  // of what goes [s]
  if (way == Bridge::torn) {
    tears_at(body, 2, low, 0.1);
  } else {
    // Three quarters of the neck at once, then element by element.
    std::vector<std::vector<int>> gone(1);
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      const Vec3 x = middle_of(mesh, t);
      if (x.z() < low || x.z() > high) continue;
      if (x.x() < 0.5 * size || x.y() < 0.5 * size)
        gone.front().push_back(static_cast<int>(t));
      else
        gone.push_back({static_cast<int>(t)});
    }
    o.removed = [gone](double from, double to) {
      std::vector<int> now;
      for (std::size_t k = 0; k < gone.size(); ++k) {
        const double at = begins + every * static_cast<double>(k == 0 ? 0 : k + 4);
        if (at > from && at <= to) now.insert(now.end(), gone[k].begin(), gone[k].end());
      }
      return now;
    };
  }
  constexpr double free = 0.5e-3, way_there = 1.5e-3;
  constexpr double back = begins + goes_for + stays, ends = back + moves + stays;
  ProcedureHand hand;
  if (way == Bridge::pressed) {
    hand.at = [=](double t) -> Vec3 {
      return Vec3(0.5 * size + 2e-3, 0.5 * size + 1e-3,
                  size + tip_radius + free - (free + lead * way_there) * there_and_back(t, moves, back));
    };
  } else if (way == Bridge::drawn) {
    hand.at = [=](double t) -> Vec3 {
      const double down = smooth_step(t / 0.3), up = smooth_step((t - 0.6) / 0.4),
                   off = smooth_step((t - back) / moves);
      return Vec3(0.5 * size + 1e-3, 0.5 * size,
                  size + free - (free + lead * 0.2e-3) * down + lead * 0.6e-3 * up + 6e-3 * off);
    };
    hand.pedals = [=](double t) -> std::uint32_t { return t > 0.4 && t < back ? pedal_aspiration : 0u; };
  } else {
    const double z = 9e-3;
    hand.at = [=](double t) -> Vec3 {
      return Vec3(size + tip_radius + free - (free + lead * 2 * way_there) * there_and_back(t, moves, back),
                  0.5 * size + 1e-3, z);
    };
    o.along = -Vec3::UnitX();
  }
  o.hands = {hand};
  o.duration = ends;
  o.rests = {{begins - looked, begins}, {ends - looked, ends}};
  o.loading = {0, way == Bridge::drawn ? 0.4 : moves};
  return o;
}

// Two balls on a piece that springs of this stiffness hold, or nothing: pressed together, carried up, let go.
Procedure wedged(const StabilityBench& bench, double springs, double rate, double lead) {
  constexpr double size = 6e-3, free = 0.5e-3, pressed = 0.8e-3, carried = 3e-3;
  Procedure o = procedure_on(bench, box_mesh(Vec3(size, size, size), 4, 4, 4),
                             {ball_on_a_stick(-Vec3::UnitX()), ball_on_a_stick(Vec3::UnitX())});
  o.scene.rate = rate;
  if (springs > 0) hold_by_springs(o.scene.bodies.front(), springs, size);
  constexpr double carries = moves + stays, opens = carries + moves + stays, ends = opens + moves + stays;
  for (const double side : {-1.0, 1.0})
    o.hands.push_back({[=](double t) -> Vec3 {
      const double squeezed = there_and_back(t, moves, opens);
      return Vec3(0.5 * size + side * (0.5 * size + tip_radius + free - (free + lead * pressed) * squeezed),
                  0.5 * size, 0.5 * size + carried * smooth_step((t - carries) / moves));
    }});
  o.duration = ends;
  o.rests = {{carries - looked, carries}, {opens - looked, opens}, {ends - looked, ends}};
  o.along = Vec3::UnitX();
  o.loading = {0, moves};
  return o;
}

}  // namespace

StabilityPlan plan_cracking(StabilityBench& bench, bool quick) {
  std::vector<ProcedureWay> ways;
  const auto add = [&](double toughness, double takes, double apart) {
    if (quick && !ways.empty()) return;
    char name[80];
    std::snprintf(name, sizeof name, "%.2f J/m², %.1f mm in %.2f s", toughness, 1e3 * apart, takes);
    ways.push_back({name, [=, &bench](double lead) { return crack(bench, toughness, takes, apart, lead); }});
  };
  for (const double toughness : {0.1, 0.02, 0.3})
    for (const double takes : {0.5, 0.15, 1.5}) add(toughness, takes, 2.5e-3);
  for (const double apart : {2.8e-3, 3.4e-3}) add(0.3, 0.15, apart);  // what tears then has most to give back
  StabilityPlan plan = procedure_plan(std::move(ways), quick);
  plan.parameter =
      "displayed stiffness [N/m] of a groove whose walls two hands push apart until its bridge tears";
  return plan;
}

StabilityPlan plan_last_bridge(StabilityBench& bench, bool quick) {
  std::vector<ProcedureWay> ways;
  constexpr struct {
    const char* name;
    Bridge way;
  } all[] = {{"pressed", Bridge::pressed},
             {"pushed aside", Bridge::aside},
             {"pushed aside until it tears", Bridge::torn},
             {"drawn by a port", Bridge::drawn}};
  for (const auto& [name, way] : all)
    if (!quick || ways.empty())
      ways.push_back({name, [&bench, way = way](double lead) { return last_bridge(bench, way, lead); }});
  StabilityPlan plan = procedure_plan(std::move(ways), quick);
  plan.parameter = "displayed stiffness [N/m] of a piece whose last bridge goes while a hand is on it";
  return plan;
}

StabilityPlan plan_wedged_piece(StabilityBench& bench, bool quick) {
  std::vector<ProcedureWay> ways;
  for (const double springs : {0.0, 2.0})
    for (const double rate : {50.0, 25.0, 100.0}) {
      if (quick && !ways.empty()) continue;
      char name[80];
      std::snprintf(name, sizeof name, "springs of %.0f N/m, %.0f Hz", springs, rate);
      ways.push_back(
          {name, [&bench, springs, rate](double lead) { return wedged(bench, springs, rate, lead); }});
    }
  StabilityPlan plan = procedure_plan(std::move(ways), quick);
  plan.parameter = "displayed stiffness [N/m] to each of two hands of a piece that they hold between them";
  return plan;
}

}  // namespace hapticd
