// Modes of tissue on its own: whatever a step is linearised at, a body without a hand on it makes no energy.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "physics/simulation/step/energy_bound.h"
#include "physics/simulation/world.h"
#include "physics/tissue/stored_energy.h"
#include "tests/support/mesh_shapes.h"
#include "tools/stability/stability_plans.h"

namespace hapticd {
namespace {

constexpr double duration = 8;  // [s]
constexpr double lead = 0.9;    // of a step, as the daemon's (scene_world.cpp)
constexpr const char* judged = "energy made in a step, or left at the end, of the largest there was";

struct Way {
  double poisson, rate;
  ComplianceMethod method;
  Law law;
};

std::vector<Way> ways(bool quick) {
  std::vector<Way> all;
  for (const double poisson : {0.3, 0.45, 0.49})
    for (const double rate : {25.0, 50.0, 100.0, 200.0})
      for (const ComplianceMethod method : {ComplianceMethod::exact, ComplianceMethod::zone,
                                            ComplianceMethod::lazy, ComplianceMethod::updown})
        for (const Law law : {Law::corotational, Law::guarded})
          if (!quick ||
              (poisson == 0.45 && rate == 50 && law == Law::corotational && method <= ComplianceMethod::zone))
            all.push_back({poisson, rate, method, law});
  return all;
}

std::string name_of(const Way& way) {
  constexpr const char* names[] = {"exact", "zone", "lazy", "updown", "dense"};
  char text[96];
  std::snprintf(text, sizeof text, "%s, %s, Poisson's ratio %.2f, %.0f Hz",
                names[static_cast<int>(way.method)], way.law == Law::guarded ? "guarded" : "corotational",
                way.poisson, way.rate);
  return text;
}

Instrument ball(double radius) {
  Primitive tip;
  tip.shape = Shape::sphere;
  tip.radius = radius;
  Instrument instrument;
  instrument.primitives = {tip};
  return instrument;
}

// A body, what holds it and what happens to it before it is left alone.
struct Setup {
  TetMesh mesh;
  std::vector<int> fixed;
  Vec3 gravity = Vec3::Zero();
  Instrument instrument = ball(4e-3);
  double toughness = 0;  // over Young's modulus [m]
  int new_nodes = 0;
  // The instrument at a time; not present when it is gone.
  std::function<InstrumentSample(double)> hand = [](double) { return InstrumentSample{}; };
  // What goes at a time since the last step.
  std::function<std::vector<int>(double from, double to)> removed = [](double, double) {
    return std::vector<int>{};
  };
};

// H = kinetic + elastic + potential [J]
double energy_of(const Body& body) {
  double height = 0;
  for (int n = 0; n < body.model.node_count(); ++n)
    height -= body.state.mass[n] * body.model.gravity.dot(body.state.x[n] - body.rest()[n]);
  const VecX none = VecX::Zero(3 * static_cast<Eigen::Index>(body.state.x.size()));
  return kinetic_energy(body.model, body.state) + stored_energy(body.model, body.state, none) + height;
}

StabilityTrial left_alone(const Setup& setup, double young, const Way& way, bool keeps_energy) {
  WorldSettings settings;
  settings.h = 1 / way.rate;
  settings.alarm_distance = 5e-3;
  settings.sample_spacing = 1.5e-3;
  settings.gravity = setup.gravity;
  settings.coupling[0] = {400, 0.04, 2e-3};
  settings.compliance = way.method;
  settings.lead = lead / way.rate;
  settings.keeps_energy = keeps_energy;
  BodySettings b{"body", true, setup.mesh, {young, way.poisson, 1000, 2, 0.002}, setup.fixed, 0, true};
  b.material.law = way.law;
  b.toughness = setup.toughness * young;
  b.room = {setup.new_nodes, 6 * setup.new_nodes};
  World world({std::move(b)}, setup.instrument, settings);
  const auto problem = std::make_unique<CondensedProblem>();
  const Body& body = world.bodies().front();

  StabilityTrial trial;
  double before = energy_of(body), largest = 0, rise = 0;
  const int steps = static_cast<int>(std::ceil(duration * way.rate));
  for (int k = 0; k < steps; ++k) {
    const double t = k * settings.h;
    for (ReferenceJob& job : world.wanted_references()) {
      job.reference->make();
      world.adopt(std::move(job));
    }
    const std::vector<int> gone = setup.removed(t - settings.h, t);
    if (!gone.empty()) world.schedule_removal(0, gone);
    const InstrumentSample sample = setup.hand(t);
    world.step([&] { return sample; }, *problem);
    const double now = energy_of(body);
    if (!std::isfinite(now)) {
      rise = std::numeric_limits<double>::infinity();
      break;
    }
    largest = std::max(largest, std::abs(now));
    if (gone.empty() && !sample.present) rise = std::max(rise, now - before);
    trial.trace.emplace_back(t, 1e3 * now);
    before = now;
  }
  // The comparison methods may be slow to rest: they are stale.
  const bool rests = way.method == ComplianceMethod::exact || way.method == ComplianceMethod::zone;
  const double left = rests ? kinetic_energy(body.model, body.state) : 0;
  trial.judged = std::max(rise, left) / std::max(largest, std::numeric_limits<double>::min());
  return trial;
}

StabilityPlan plan_of(bool quick, const Setup& setup) {
  StabilityPlan plan;
  plan.naive = "linearised where the motion is foreseen, whatever comes of it (exact, 50 Hz)";
  plan.ours =
      "each step keeps so much of its motion as makes no energy; the worst of all methods, both laws, "
      "Poisson's ratios of 0.3 to 0.49 and 25 to 200 Hz";
  plan.judged = judged;
  plan.limit = 1e-6;
  plan.reason = "1 MPa: from the softest tissue to cartilage";
  plan.required = 1000;
  plan.goes_on = true;
  plan.trace_y = "energy [mJ]";
  plan.values = quick ? std::vector<double>{1000} : std::vector<double>{1, 10, 100, 1000};
  plan.run_naive = [setup](double kpa) {
    return left_alone(setup, 1e3 * kpa, {0.45, 50, ComplianceMethod::exact, Law::corotational}, false);
  };
  plan.run_ours = [setup, quick](double kpa) {
    StabilityTrial worst;
    worst.judged = -1;
    for (const Way& way : ways(quick)) {
      StabilityTrial trial = left_alone(setup, 1e3 * kpa, way, true);
      if (trial.judged <= worst.judged) continue;
      trial.worst_of = name_of(way);
      worst = std::move(trial);
    }
    return worst;
  };
  return plan;
}

Setup beam(const Vec3& size = {0.08, 0.005, 0.005}, int along = 16, int across = 2) {
  Setup setup;
  setup.mesh = box_mesh(size, along, across, across);
  for (int n = 0; n < static_cast<int>(setup.mesh.nodes.size()); ++n)
    if (setup.mesh.nodes[n].x() == 0) setup.fixed.push_back(n);
  return setup;
}

}  // namespace

StabilityPlan plan_slender(StabilityBench&, bool quick) {
  Setup setup = beam();
  setup.gravity = Vec3(0, 0, -9.81);
  StabilityPlan plan = plan_of(quick, setup);
  plan.parameter = "Young's modulus of a beam under its own weight, 80 mm × 5 mm × 5 mm [kPa]";
  return plan;
}

StabilityPlan plan_let_go(StabilityBench&, bool quick) {
  Setup setup = beam();
  setup.hand = [](double t) {
    constexpr double pressed = 0.4, depth = 6e-3, radius = 4e-3;
    InstrumentSample sample;
    sample.present = t < pressed;
    sample.pose = {Vec3(0.075, 0.0025, 0.005 + radius - depth * std::min(1.0, t / (0.5 * pressed))),
                   Quat::Identity()};
    return sample;
  };
  StabilityPlan plan = plan_of(quick, setup);
  plan.parameter = "Young's modulus of a beam that is pressed and let go [kPa]";
  return plan;
}

StabilityPlan plan_remnant(StabilityBench&, bool quick) {
  Setup setup;
  constexpr double size = 0.01;
  setup.mesh = box_mesh(Vec3(size, size, size), 6, 6, 6);
  setup.gravity = Vec3(0, 0, -9.81);
  const auto& x = setup.mesh.nodes;
  // The three nodes next to a corner of the lid, and of the elements those that are nearest to it.
  const Vec3 corner(0, 0, size);
  std::vector<int> nodes(x.size()), tets(setup.mesh.tets.size());
  for (std::size_t n = 0; n < nodes.size(); ++n) nodes[n] = static_cast<int>(n);
  for (std::size_t t = 0; t < tets.size(); ++t) tets[t] = static_cast<int>(t);
  const auto distance = [&](int t) {
    Vec3 middle = Vec3::Zero();
    for (const int n : setup.mesh.tets[t]) middle += 0.25 * x[n];
    return (middle - corner).norm();
  };
  std::sort(nodes.begin(), nodes.end(),
            [&](int a, int b) { return (x[a] - corner).norm() < (x[b] - corner).norm(); });
  std::sort(tets.begin(), tets.end(), [&](int a, int b) { return distance(a) < distance(b); });
  setup.fixed.assign(nodes.begin(), nodes.begin() + 3);
  setup.removed = [tets](double from, double to) {
    constexpr double first = 0.5, every = 0.1;
    constexpr std::size_t left = 150, parts = 10;
    std::vector<int> gone;
    for (std::size_t p = 0; p < parts; ++p)
      if (const double at = first + every * static_cast<double>(p); at > from && at <= to) {
        const auto end = tets.end() - static_cast<std::ptrdiff_t>(p * (tets.size() - left) / parts);
        const auto begin = tets.end() - static_cast<std::ptrdiff_t>((p + 1) * (tets.size() - left) / parts);
        gone.insert(gone.end(), begin, end);
      }
    return gone;
  };
  StabilityPlan plan = plan_of(quick, setup);
  plan.parameter =
      "Young's modulus of a remnant of 150 elements on three nodes, cut from a cube of 10 mm [kPa]";
  return plan;
}

// A blade comes down through the beam next to where it is held, and is gone before the last of it is cut:
// what hangs there swings on a hinge.
StabilityPlan plan_bridge(StabilityBench&, bool quick) {
  constexpr double at = 4e-3, length = 20e-3, height = 5e-3, width = 8e-3, speed = 10e-3, above = 1e-3,
                   bridge = 0.6e-3;
  Setup setup = beam(Vec3(length, height, height), 8, 3);
  setup.gravity = Vec3(0, 0, -9.81);
  setup.toughness = 1e-4;
  setup.new_nodes = 600;
  setup.instrument = {};
  setup.instrument.blade = make_blade({Vec3(0, -width / 2, 0), Vec3(0, width / 2, 0)}, Vec3(0, 0, -1), 16);
  std::vector<Vec3> corners;
  for (const double x : {-0.05e-3, 0.05e-3})
    for (const double y : {-width / 2, width / 2})
      for (const double z : {2e-3, 8e-3}) corners.emplace_back(x, y, z);
  setup.instrument.primitives = {make_convex("sheet", corners, {})};
  setup.hand = [=](double t) {
    InstrumentSample sample;
    const double gone = speed * t - above;  // into the beam, where it does not give way
    sample.present = gone < height - bridge;
    sample.pose = {Vec3(at, height / 2, height - gone), Quat::Identity()};
    return sample;
  };
  StabilityPlan plan = plan_of(quick, setup);
  plan.parameter =
      "Young's modulus of a beam that a blade cuts to the last bridge, under its own weight [kPa]";
  return plan;
}

}  // namespace hapticd
