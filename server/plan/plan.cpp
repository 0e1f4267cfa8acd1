#include "server/plan/plan.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include <nlohmann/json.hpp>

#include "physics/compliance/compliance.h"
#include "physics/tissue/mesh_quality.h"
#include "physics/tissue/surface.h"
#include "server/files/format.h"
#include "server/files/input_error.h"
#include "server/plan/model_trial.h"
#include "server/scene/plausibility.h"
#include "server/scene/scene_bodies.h"
#include "server/scene/scene_describe.h"

namespace hapticd {
namespace {

constexpr double worth_it = 0.97;            // of the cost: a choice that saves less is not made
constexpr double kept_back = 0.8;            // of the accuracy: the rest is for what the stroke does not show
constexpr double no_better = 1.05;           // of the whole model's error, where that is nearly the accuracy
constexpr double on_time = 0.8;              // of a period
constexpr double reference_budget_ms = 800;  // of CPU time
constexpr double pilots_budget_ms = 1000;
constexpr int usual_pilots = 6;
constexpr double settled = 0.1;                                // that a run holds the first pose [s]
constexpr double longest_stroke = 1.2, shortest_stroke = 0.2;  // [s]
constexpr std::size_t largest_exact = 2500;                    // nodes of a body; beyond, a step misses 50 Hz
constexpr std::size_t least_zone = 600;  // below, a factor costs less than a zone's solves
constexpr int probed_nodes = 24;         // of a body's surface, for its compliance

bool deforms(const SceneBody& b) { return b.kind == BodyKind::deformable && b.simulated; }

std::size_t largest_body(const Scene& scene) {
  std::size_t nodes = 0;
  for (const SceneBody& b : scene.bodies)
    if (deforms(b)) nodes = std::max(nodes, b.mesh.nodes.size());
  return nodes;
}

// Largest n·C n over surface nodes, of the elastic body alone at rest [m/N].
double softest_node(const SceneBody& body) {
  TissueModel model = make_tissue_model(body.mesh, body.material, body.fixed_nodes, Vec3::Zero());
  for (const TissueRegion& region : body.regions) set_region(model, region);
  set_springs(model, body.springs);
  model.dynamic = false;
  const auto compliance = make_exact_compliance(model, 1);
  compliance->update(rest_state(model));
  const BoundarySurface surface(model.mesh);
  const std::size_t every = 1 + surface.faces().size() / probed_nodes;
  double softest = 0;
  VecX f(3 * model.node_count());
  for (std::size_t i = 0; i < surface.faces().size(); i += every) {
    const Triangle& t = surface.faces()[i].nodes;
    const auto& x = model.mesh.nodes;
    const Vec3 normal = (x[t[1]] - x[t[0]]).cross(x[t[2]] - x[t[0]]).stableNormalized();
    // A unit force spread over the face: a contact is never a point.
    f.setZero();
    for (const int n : t) f.segment<3>(3 * n) = normal / 3;
    const VecX load = f;
    compliance->apply(load, f);
    softest = std::max(softest, load.dot(f));
  }
  return softest;
}

class Planner {
 public:
  Planner(const Scene& scene, const PlanOptions& options)
      : begun_(std::chrono::steady_clock::now()), options_(options) {
    plan_.scene = scene;
    chooses_ = scene.plans;
    plan_.scene.plans = false;
  }

  Plan make() {
    for (SceneBody& body : plan_.scene.bodies) leave_out(body);
    for (SceneBody& body : plan_.scene.bodies) make_rigid(body);
    measure();
    for (std::size_t b = 0; b < plan_.scene.bodies.size(); ++b) choose_for_body(b);
    choose_compliance();
    choose_friction();
    choose_contact();
    finish();
    return std::move(plan_);
  }

 private:
  Scene& scene() { return plan_.scene; }
  void say(std::string term, std::string choice, std::string reason, double cost = 0, double error = 0) {
    plan_.lines.push_back({std::move(term), std::move(choice), std::move(reason), cost, error});
  }

  const char* as_set() const { return touches_ ? "pinned by the scene" : "as the scene has it"; }

  bool has_contacts(const SceneBody& body) const {
    const auto index = &body - plan_.scene.bodies.data();
    return std::any_of(plan_.scene.contacts.begin(), plan_.scene.contacts.end(),
                       [&](const ContactPair& p) { return p.points == index || p.faces == index; });
  }

  void leave_out(SceneBody& body) {
    if (!deforms(body)) {
      say(body.name, "obstacle",
          body.kind == BodyKind::rigid ? "the scene says rigid" : "pinned: simulated: false");
      return;
    }
    const double beyond = beyond_reach(plan_.scene, body);
    if (!chooses_ || body.pinned_simulated || has_contacts(body) || beyond < 0) return;
    body.simulated = false;
    say(body.name, "not simulated",
        format("%.3g mm beyond the device's workspace and no body's contact: nobody can feel it",
               1e3 * beyond));
  }

  void make_rigid(SceneBody& body) {
    if (!chooses_ || !deforms(body) || body.pinned_simulated || !may_be_static(body)) return;
    if (body.mesh.nodes.size() > largest_exact) return;
    const auto felt = [&](const SceneBody& b) { return deforms(b) && beyond_reach(plan_.scene, b) < 0; };
    if (std::count_if(plan_.scene.bodies.begin(), plan_.scene.bodies.end(), felt) < 2) return;
    const double c = softest_node(body);
    const double share = c / (c + 1 / scene().first().coupling.stiffness);
    // What is left for the rest must still be most of it.
    if (share > 0.25 * scene().accuracy) return;
    body.simulated = false;
    say(body.name, "rigid",
        format("gives way by %.2g m/N at most, the coupling by %.2g: left out it changes the force by %.2g",
               c, 1 / scene().first().coupling.stiffness, share),
        0, share);
    rigid_error_ += share;
  }

  // A tissue that no hand can touch is no scene: most often its mesh is in another unit.
  [[noreturn]] void refuse_out_of_reach() const {
    const SceneBody* nearest = nullptr;
    for (const SceneBody& b : plan_.scene.bodies)
      if (b.kind == BodyKind::deformable &&
          (!nearest || beyond_reach(plan_.scene, b) < beyond_reach(plan_.scene, *nearest)))
        nearest = &b;
    if (!nearest)
      throw InputError(plan_.scene.file, 0, "bodies", "none deforms: there is nothing to simulate");
    const double size = measure_mesh(nearest->mesh).diagonal();
    const std::string unit = unit_question(size);
    throw InputError(
        plan_.scene.file, 0, "bodies",
        format("nothing that deforms is within the device's reach: %s is %.3g mm beyond it, and %.3g "
               "mm from corner to corner%s (mapping.origin, mapping.position_scale)",
               nearest->name.c_str(), 1e3 * beyond_reach(plan_.scene, *nearest), 1e3 * size, unit.c_str()));
  }

  void measure() {
    if (largest_body(scene()) > largest_exact && chooses_ && !scene().pinned_compliance)
      scene().compliance = ComplianceMethod::zone;
    // One short run tells what a step costs, and so how long a stroke the budget pays for.
    const PilotStroke shortly = pilot_stroke(scene(), 0.1);
    if (shortly.pose.empty()) refuse_out_of_reach();
    const TrialRun first = run_pilot(scene(), shortly);
    const double step = std::max(0.05, first.cost_ms);
    const double h_ms = 1e3 / scene().rate;
    double seconds = std::clamp(pilots_budget_ms / usual_pilots / step * h_ms * 1e-3 - settled,
                                shortest_stroke, longest_stroke);
    // A shorter stroke rather than a reference of longer steps, within reason.
    every_ms_ = std::max(1, static_cast<int>(h_ms));
    for (const int every : {1, 2, 4, 5}) {
      if (every >= h_ms) break;
      every_ms_ = every;
      const double affordable = 1e-3 * every * reference_budget_ms / std::max(0.02, first.step_ms) - settled;
      if (affordable < 0.6 * seconds && every < 5) continue;
      seconds = std::clamp(affordable, std::min(shortest_stroke, seconds), seconds);
      break;
    }
    stroke_ = pilot_stroke(scene(), seconds);
    plan_.stroke = stroke_.text;
    reference_ = run_reference(scene(), stroke_, every_ms_);
    now_ = run_pilot(scene(), stroke_);
    whole_jump_ = jump_of(now_);
    error_ = error_of(now_);
    // Where the whole model misses the accuracy, nothing says that what looks no worse is.
    allowed_ = error_ <= scene().accuracy ? std::max(kept_back * scene().accuracy, no_better * error_) : 0;
    whole_error_ = error_;
    plan_.felt = felt_along(stroke_, reference_, every_ms_);
    touches_ = std::any_of(reference_.force.begin(), reference_.force.end(),
                           [](const Vec3& f) { return f.squaredNorm() > 0; });
    // An error of nothing would allow everything.
    if (!touches_) chooses_ = false;
  }

  double jump_of(const TrialRun& run) const {
    return swap_jump(reference_.force, every_ms_, run.force, run.swapped);
  }
  double error_of(const TrialRun& run) const {
    return rigid_error_ + felt_error(force_error(reference_, run, every_ms_), jump_of(run), whole_jump_);
  }

  bool in_time(const TrialRun& run) const {
    return run.worst_step_ms <= on_time * 1e3 / plan_.scene.rate && run.tick_ms <= on_time;
  }

  // Runs the scene with a choice made; keeps it if it pays. `richer` and `cheaper` name the two.
  template <typename Change>
  void choose(const std::string& term, const char* richer, const char* cheaper, const Change& change) {
    Scene candidate = scene();
    change(candidate);
    const TrialRun run = run_pilot(candidate, stroke_);
    const double error = error_of(run);
    const bool idle = now_.worst_step_ms < options_.idle_share * 1e3 / scene().rate;
    const double most = idle ? std::min(allowed_, no_better * whole_error_) : allowed_;
    const bool exact_enough = error <= most, cheaper_too = run.cost_ms < worth_it * now_.cost_ms;
    const bool needed = !in_time(now_) && in_time(run);
    const std::string measured =
        format("%.2f ms and error %.2g against %.2f ms and %.2g", run.cost_ms, error, now_.cost_ms, error_);
    if ((exact_enough && cheaper_too) || (needed && std::isfinite(error))) {
      say(term, cheaper,
          std::string(cheaper) + " costs " + measured + (exact_enough ? "" : ": for the rate's sake"), 0,
          std::max(0.0, error - error_));
      scene() = std::move(candidate);
      now_ = run;
      error_ = error;
      return;
    }
    say(term, richer,
        std::string(cheaper) + " would cost " + measured +
            (allowed_ == 0      ? std::string(": kept whole, for even that misses the accuracy")
             : error > allowed_ ? format(": more than %.2g", allowed_)
             : !exact_enough    ? std::string(": not traded, a step takes less than half a period")
                                : std::string(": saves nothing")),
        std::max(0.0, now_.cost_ms - run.cost_ms), 0);
  }

  void choose_for_body(std::size_t b) {
    const SceneBody body = scene().bodies[b];
    if (!deforms(body)) return;
    const bool pressed = !now_.pressed.empty() && now_.pressed[b];
    const auto fixed_choice = [&](const char* what, const char* choice, bool pinned) {
      say(body.name + ": " + what, choice,
          pinned || !chooses_ ? as_set()
                              : "the stroke does not press it: kept whole, asleep it costs "
                                "nothing");
    };
    if (!chooses_ || body.pinned_elements || !pressed || !body.corotational)
      fixed_choice("elements", body.corotational ? "corotational" : "linear", body.pinned_elements);
    else
      choose(body.name + ": elements", "corotational", "linear",
             [b](Scene& s) { s.bodies[b].corotational = false; });
    if (!may_be_static(body) && !body.pinned_motion)
      say(body.name + ": motion", "dynamic",
          body.removable || body.toughness > 0 ? "it can be cut: pieces cut loose need their mass"
                                               : "nothing holds it but its mass");
    else if (!chooses_ || body.pinned_motion || !pressed || !body.dynamic)
      fixed_choice("motion", body.dynamic ? "dynamic" : "static", body.pinned_motion);
    else
      choose(body.name + ": motion", "dynamic", "static", [b](Scene& s) { s.bodies[b].dynamic = false; });
  }

  void choose_compliance() {
    static const char* const names[] = {"exact", "zone", "lazy", "updown", "dense"};
    const char* now = names[static_cast<int>(scene().compliance)];
    const bool one = std::none_of(scene().bodies.begin(), scene().bodies.end(),
                                  [](const SceneBody& b) { return deforms(b) && b.corotational; });
    if (!chooses_ || scene().pinned_compliance)
      say("compliance", now, as_set());
    else if (scene().compliance == ComplianceMethod::zone)
      say("compliance", now, format("a body of %zu nodes: exact misses the rate", largest_body(scene())));
    else if (one)
      say("compliance", now, "nothing turns: one factor serves until the zone moves");
    else if (largest_body(scene()) < least_zone)
      say("compliance", now,
          format("%zu nodes: a factor costs less than a zone's solves", largest_body(scene())));
    else
      choose("compliance", "exact", "zone", [](Scene& s) { s.compliance = ComplianceMethod::zone; });
  }

  void choose_friction() {
    double mu = 0;
    for (const SceneBody& b : scene().bodies) mu = std::max(mu, b.friction);
    for (const ContactPair& p : scene().contacts) mu = std::max(mu, p.friction);
    if (mu == 0)
      say("friction", "none", "no body has any");
    else if (!chooses_ || scene().pinned_friction)
      say("friction", scene().friction ? "on" : "off", as_set());
    else
      choose("friction", "on", "off", [](Scene& s) { s.friction = false; });
  }

  void choose_contact() {
    if (!chooses_ || scene().pinned_contact)
      say("contact", scene().contact == Renewal::renewed ? "renewed" : "frozen", as_set());
    else
      choose("contact", "renewed", "frozen", [](Scene& s) { s.contact = Renewal::frozen; });
  }

  void finish() {
    plan_.cost_ms = now_.cost_ms;
    plan_.step_ms = now_.worst_step_ms;
    plan_.tick_ms = now_.tick_ms;
    plan_.error_estimate = error_;
    plan_.met = error_ <= scene().accuracy;
    plan_.on_time = in_time(now_);
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begun_;
    plan_.seconds = took.count();
    say("total",
        plan_.met && plan_.on_time ? "meets accuracy and rate"
        : plan_.met                ? "MISSES THE RATE"
                                   : "misses the accuracy",
        std::string(touches_ ? "" : "the stroke touches nothing, so nothing was chosen; ") +
            format("accuracy %.2g; a step takes up to %.2f of %.1f ms, a tick %.3f of 1 ms%s",
                   scene().accuracy, plan_.step_ms, 1e3 / scene().rate, plan_.tick_ms,
                   plan_.met
                       ? ""
                       : format("; the whole model's own error at this rate is %.2g", whole_error_).c_str()),
        plan_.cost_ms, plan_.error_estimate);
  }

  std::chrono::steady_clock::time_point begun_;
  const PlanOptions options_;
  Plan plan_;
  bool chooses_ = true;
  PilotStroke stroke_;
  int every_ms_ = 1;
  TrialRun reference_, now_;  // now_: of the plan as it stands
  bool touches_ = true;       // the stroke touches something
  double rigid_error_ = 0, error_ = 0, whole_error_ = 0, whole_jump_ = 0, allowed_ = 0;
};

}  // namespace

Plan make_plan(const Scene& scene, const PlanOptions& options) { return Planner(scene, options).make(); }

std::string describe(const Plan& plan) {
  std::string out = format("plan       along %s, %.1f s; cost in CPU ms per step, error of the peak force\n",
                           plan.stroke.c_str(), plan.seconds);
  for (const PlanLine& line : plan.lines)
    out += format("           %-22s %-14s %7.2f ms %8.2g  ", line.term.c_str(), line.choice.c_str(),
                  line.cost_ms, line.error_estimate) +
           line.reason + '\n';
  out += describe(plan.felt, plan.scene.first());
  for (const std::string& doubt : doubts(plan.scene)) out += "doubt      " + doubt + '\n';
  return out;
}

nlohmann::ordered_json to_json(const Plan& plan) {
  nlohmann::ordered_json json;
  json["command"] = "check";
  json["scene"] = plan.scene.name;
  json["instruments"] = instruments_to_json(plan.scene);
  json["accuracy"] = plan.scene.accuracy;
  json["stroke"] = plan.stroke;
  json["met"] = plan.met;
  json["on_time"] = plan.on_time;
  json["cost_ms"] = plan.cost_ms;
  json["error_estimate"] = plan.error_estimate;
  json["seconds"] = plan.seconds;
  json["felt"] = {{"peak_n", plan.felt.peak}, {"stiffness_n_per_m", nullptr}};  // in the scene
  if (plan.felt.stiffness) json["felt"]["stiffness_n_per_m"] = *plan.felt.stiffness;
  json["doubts"] = doubts(plan.scene);
  json["plan"] = nlohmann::ordered_json::array();
  for (const PlanLine& line : plan.lines)
    json["plan"].push_back({{"term", line.term},
                            {"choice", line.choice},
                            {"reason", line.reason},
                            {"cost_ms", line.cost_ms},
                            {"error_estimate", line.error_estimate}});
  return json;
}

}  // namespace hapticd
