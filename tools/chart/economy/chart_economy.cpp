#include "tools/chart/economy/chart_economy.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/files/input_error.h"
#include "server/plan/model_trial.h"
#include "server/plan/plan_stroke.h"
#include "server/record/trajectory_reader.h"
#include "server/scene/scene_bodies.h"
#include "tools/offline/offline_run.h"

namespace hapticd {
namespace {

constexpr double end_margin = 0.05;  // of the trajectory that is left out [s]

double error_against(const std::vector<OfflineTick>& reference, const std::vector<OfflineTick>& run) {
  double squares = 0, peak = 0;
  const std::size_t ticks = std::min(reference.size(), run.size());
  for (std::size_t i = 0; i < ticks; ++i) {
    squares += (run[i].wrench - reference[i].wrench).head<3>().squaredNorm();
    peak = std::max(peak, reference[i].wrench.head<3>().norm());
  }
  const double error = std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, ticks))) / peak;
  return std::isfinite(error) ? error : std::numeric_limits<double>::infinity();
}

double jump_against(const std::vector<OfflineTick>& reference, const std::vector<OfflineTick>& run) {
  std::vector<Vec3> expected, force;
  std::vector<std::uint8_t> swapped;
  for (const OfflineTick& t : reference) expected.push_back(t.wrench.head<3>());
  for (const OfflineTick& t : run) {
    force.push_back(t.wrench.head<3>());
    swapped.push_back(t.swapped);
  }
  return swap_jump(expected, 1, force, swapped);
}

// Of the hand that is worst off.
double worst_hand(double (*measure)(const std::vector<OfflineTick>&, const std::vector<OfflineTick>&),
                  const OfflineResult& reference, const OfflineResult& run) {
  double most = 0;
  for (int i = 0; i < max_instruments; ++i) {
    if (reference.hands[i].empty()) continue;
    const double of_hand = measure(reference.hands[i], run.hands[i]);
    if (!(of_hand <= most)) most = of_hand;  // also where it is no number
  }
  return most;
}

std::string label_of(const Scene& scene) {
  std::string label;
  bool friction = false;
  for (const SceneBody& b : scene.bodies) {
    friction = friction || b.friction > 0;
    if (b.kind == BodyKind::rigid) continue;
    label += b.name +
             (!b.simulated     ? " still"
              : b.corotational ? (b.dynamic ? " corotational" : " corotational static")
                               : (b.dynamic ? " linear" : " linear static")) +
             ", ";
  }
  for (const ContactPair& p : scene.contacts) friction = friction || p.friction > 0;
  if (friction) label += scene.friction ? "friction, " : "no friction, ";
  return label + (scene.contact == Renewal::renewed ? "renewed" : "frozen");
}

struct BodyChoice {
  bool simulated, corotational, dynamic;
};

std::vector<Scene> models_of(const Scene& scene) {
  std::vector<Scene> out = {scene};
  out.front().plans = false;
  const auto multiply = [&](const auto& changes) {
    std::vector<Scene> more;
    for (const Scene& s : out)
      for (const auto& change : changes) {
        more.push_back(s);
        change(more.back());
      }
    out = std::move(more);
  };
  using Change = std::function<void(Scene&)>;
  bool friction = false;
  for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
    const SceneBody& body = scene.bodies[b];
    friction = friction || body.friction > 0;
    if (body.kind == BodyKind::rigid || !body.simulated) continue;
    std::vector<BodyChoice> choices = {{true, true, true}, {true, false, true}};
    if (may_be_static(body)) choices.insert(choices.end(), {{true, false, false}, {false, true, true}});
    if (beyond_reach(scene, body) >= 0) choices = {{false, true, true}};
    std::vector<Change> changes;
    for (const BodyChoice& c : choices)
      changes.push_back([b, c](Scene& s) {
        s.bodies[b].simulated = c.simulated;
        s.bodies[b].corotational = c.corotational;
        s.bodies[b].dynamic = c.dynamic;
      });
    multiply(changes);
  }
  for (const ContactPair& p : scene.contacts) friction = friction || p.friction > 0;
  if (friction) multiply(std::vector<Change>{[](Scene&) {}, [](Scene& s) { s.friction = false; }});
  multiply(std::vector<Change>{[](Scene& s) { s.contact = Renewal::renewed; },
                               [](Scene& s) { s.contact = Renewal::frozen; }});
  return out;
}

// Once with the daemon's usual delays, for the cost; and again with those its cost makes.
EconomyModel measure(const Scene& scene, const OfflineInput& input, const OfflineResult& reference) {
  EconomyModel model;
  model.label = label_of(scene);
  model.cost_ms = std::numeric_limits<double>::infinity();
  OfflineOptions options;
  const double steps = (input.to - input.from) * scene.rate;
  for (int round = 0; round < 2; ++round) {
    const OfflineResult run = run_offline(scene, input, options);
    const double step = run.simulation.quantile(50);
    options.publish_after = std::clamp(std::ceil(1e3 * step) * 1e-3, 1e-3, 1 / scene.rate);
    options.latch_after = 0.6 * options.publish_after;
    model.cost_ms =
        std::min(model.cost_ms, 1e3 * (run.simulation.total + run.haptic.total + run.bases.total) / steps);
    model.error = worst_hand(error_against, reference, run);
    model.jump = worst_hand(jump_against, reference, run);
    model.inverted = run.inverted;
  }
  return model;
}

}  // namespace

EconomyScene measure_economy(const Scene& scene, bool all, const EconomyProgress& progress) {
  EconomyScene out;
  out.scene = scene.name;
  out.accuracy = scene.accuracy;
  const auto show = [&](double fraction, const std::string& what) {
    return !progress || progress(fraction, scene.name + ": " + what);
  };
  if (!show(0, "plan")) return out;
  out.plan = make_plan(scene, {.idle_share = 0});
  OfflineInput input = along_trajectories(scene, "a plan is measured along it");
  input.to -= end_margin;
  Scene whole = scene;
  whole.plans = false;
  if (!show(0.05, "reference")) return out;
  const OfflineResult reference = run_reference(whole, input, 1e-3);
  if (all) {
    if (!show(0.1, "reference of half the step")) return out;
    out.reference_change = worst_hand(error_against, run_reference(whole, input, 0.5e-3), reference);
  }

  std::vector<Scene> models = all ? models_of(scene) : std::vector<Scene>{};
  models.insert(models.begin(), {out.plan.scene, whole});
  for (std::size_t i = 0; i < models.size(); ++i) {
    if (!show(0.2 + 0.8 * static_cast<double>(i) / static_cast<double>(models.size()), label_of(models[i])))
      return out;
    out.models.push_back(measure(models[i], input, reference));
  }
  const double whole_jump = out.models[1].jump;
  for (EconomyModel& m : out.models) m.error = felt_error(m.error, m.jump, whole_jump);
  out.chosen = out.models[0];
  out.whole = out.models[1];
  for (const EconomyModel& m : out.models) {
    // The same model measured once more: the lesser cost of all.
    if (m.label == out.chosen.label) out.chosen.cost_ms = std::min(out.chosen.cost_ms, m.cost_ms);
    if (m.error <= out.accuracy && (out.cheapest.label.empty() || m.cost_ms < out.cheapest.cost_ms))
      out.cheapest = m;
  }
  return out;
}

}  // namespace hapticd
