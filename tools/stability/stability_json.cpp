#include "tools/stability/stability_json.h"

#include <algorithm>
#include <cmath>

#include "tools/cli/report.h"
#include "tools/client/client.h"

namespace hapticd {
namespace {

// Of energies [J]: less is rounding, which goes with how the memory of an episode's thread is aligned.
constexpr int energy_digits = 21;

nlohmann::ordered_json number_or_null(double value, int decimals) {
  return value > 0 ? nlohmann::ordered_json(rounded(value, decimals)) : nlohmann::ordered_json(nullptr);
}

// To six decimals; what is smaller than 1e-3, as errors and energies may be, whole.
nlohmann::ordered_json judged_or_null(double judged) {
  if (!std::isfinite(judged)) return nullptr;
  return std::abs(judged) < 1e-3 ? rounded(judged, energy_digits) : rounded(judged, 6);
}

nlohmann::ordered_json to_json(const StabilityTrial& trial) {
  nlohmann::ordered_json j = {{"judged", judged_or_null(trial.judged)}, {"status", trial.status}};
  if (!trial.says.empty()) j["says"] = trial.says;
  if (!trial.worst_of.empty()) j["worst_of"] = trial.worst_of;
  if (!trial.loop) return j;
  // Stability and passivity, each by itself.
  const ClosedLoopResult& r = *trial.loop;
  j["swing_um"] = rounded(1e6 * r.swing, 3);
  j["surplus_uj"] = rounded(1e6 * r.surplus_min, 4);
  j["stiffness_n_m"] = rounded(r.stiffness, 2);
  j["force_max_n"] = rounded(r.force_max, 5);
  j["force_step_max_n"] = rounded(r.force_step_max, 5);
  return j;
}

nlohmann::ordered_json to_json(const std::vector<std::pair<double, double>>& trace) {
  nlohmann::ordered_json j = {{"x", nlohmann::ordered_json::array()}, {"y", nlohmann::ordered_json::array()}};
  for (const auto& [x, y] : trace) {
    j["x"].push_back(rounded(x, 4));
    j["y"].push_back(std::abs(y) < 1e-6 ? y : rounded(y, 9));  // errors may be far below
  }
  return j;
}

nlohmann::ordered_json to_json(const StabilityMode& m) {
  const StabilityPlan& plan = m.plan;
  nlohmann::ordered_json j = {{"mode", m.mode},
                              {"parameter", plan.parameter},
                              {"naive", plan.naive},
                              {"default", plan.ours},
                              {"judged", plan.judged},
                              {"limit", plan.limit},
                              {"last_sound", plan.last_sound},
                              {"naive_breaks_at", number_or_null(m.naive_breaks_at, 4)},
                              {"default_breaks_at", number_or_null(m.default_breaks_at, 4)},
                              {"analytic_bound", number_or_null(plan.analytic_bound, 3)},
                              {"required", rounded(plan.required, 4)},
                              {"required_because", plan.reason},
                              {"default_status_when_broken", m.default_breaks_at > 0 ? m.default_status : 0},
                              {"default_says", m.default_says},
                              {"ends_in_safe_state", m.ends_safe},
                              {"survives_required_range", m.survives}};
  if (!plan.values.empty()) j["swept"] = {plan.values.front(), plan.values.back()};
  const StabilityMode::Point* broken = nullptr;
  for (const StabilityMode::Point& p : m.points) {
    nlohmann::ordered_json point = {{"value", rounded(p.value, 4)}};
    if (p.has_naive) point["naive"] = to_json(p.naive);
    if (p.has_ours) point["default"] = to_json(p.ours);
    j["points"].push_back(std::move(point));
    if (p.has_naive && p.has_ours) broken = &p;
  }
  // The last value at which both ran: where the first of them breaks.
  if (broken) {
    j["trace_value"] = rounded(broken->value, 4);
    j["trace"] = {{"x", plan.trace_x},
                  {"y", plan.trace_y},
                  {"naive", to_json(broken->naive.trace)},
                  {"default", to_json(broken->ours.trace)}};
  }
  return j;
}

nlohmann::ordered_json to_json(const StiffnessPoint& p) {
  nlohmann::ordered_json j;
  if (!p.hand.empty()) j = {{"hand", p.hand}, {"source", p.source}};
  j["mass_kg"] = p.mass;
  j["damping_ns_m"] = p.damping;
  j["stiffness_n_m"] = p.stiffness;
  j["device_damping_ns_m"] = p.device_damping;
  const auto put = [&](const char* name, const Largest& of) {
    j[std::string(name) + "_n_m"] = rounded(of.steady, 1);
    j[std::string(name) + "_passive_n_m"] = rounded(of.passive, 1);
  };
  put("wall", p.wall);
  put("default", p.ours);
  put("held", p.held);
  put("wall_alike", p.alike);
  if (p.controlled.steady > 0) put("controlled", p.controlled);
  j["colgate_n_m"] = rounded(p.colgate, 1);
  const auto over = [&](const char* name, const Largest& other) {
    if (other.steady > 0) j[std::string("over_") + name] = rounded(p.ours.steady / other.steady, 3);
    if (other.passive > 0)
      j[std::string("over_") + name + "_passive"] = rounded(p.ours.passive / other.passive, 3);
  };
  over("wall", p.wall);
  over("wall_alike", p.alike);
  over("held", p.held);
  return j;
}

nlohmann::ordered_json to_json(const TrialTally& r) {
  return {{"ticks", r.ticks},
          {"steps", r.steps},
          {"in_contact", r.in_contact},
          {"latched", r.latched},
          {"saturated", r.saturated},
          {"solver_caps", r.solver_caps},
          {"removed", r.removed},
          {"force_max_n", rounded(r.force_max, 5)},
          {"device_max_n", r.device_max},
          {"farthest_mm", rounded(1e3 * r.farthest, 4)},
          {"farthest_allowed_mm", rounded(1e3 * r.farthest_allowed, 4)},
          {"fastest_mm_s", rounded(1e3 * r.fastest, 3)},
          {"fastest_allowed_mm_s", rounded(1e3 * r.fastest_allowed, 3)},
          {"gained_j", rounded(r.gained, energy_digits)},
          {"energy_j", rounded(r.energy, energy_digits)},
          {"status", r.status}};
}

nlohmann::ordered_json to_json(const RandomReport& r) {
  nlohmann::ordered_json j = to_json(static_cast<const TrialTally&>(r));
  j["hands"] = r.hands;
  if (r.cut_area > 0) {
    j["split_gained_j"] = r.split;
    j["cut_area_mm2"] = rounded(1e6 * r.cut_area, 3);
    j["nodes_added"] = r.nodes_added;
    j["episodes_out_of_room"] = r.out_of_room;
  }
  j["passivity_control"] = r.passivity_control;
  j["late_steps"] = r.late_steps;
  j["both_in_contact"] = r.both_in_contact;
  j["touching"] = r.touching;
  j["energy_made_mj"] = rounded(1e3 * r.made, 5);
  j["energy_made_by_episode_mj"] = rounded(1e3 * r.made_by_episode, 5);
  j["energy_made_by_force_mj"] = rounded(1e3 * r.made_by_force, 5);
  j["energy_absorbed_mj"] = rounded(1e3 * r.absorbed, 5);
  j["controlled_force_max_n"] = rounded(r.controlled_force_max, 5);
  j["controlled_force_rms_n"] = rounded(r.controlled_force_rms, 6);
  j["controlled_work_mj"] = rounded(1e3 * r.controlled_work, 5);
  j["faulty"] = r.faulty;
  j["faults"] = r.faults;
  return j;
}

nlohmann::ordered_json to_json(const CarveReport& r) {
  nlohmann::ordered_json j = to_json(static_cast<const TrialTally&>(r));
  j["late_steps"] = r.late_steps;
  j["strokes"] = r.strokes;
  j["free_steps"] = r.free_steps;
  j["made_j"] = r.made;
  j["made_allowed_j"] = r.made_allowed;
  j["free_energy_j"] = r.free_energy;
  j["faults"] = nlohmann::ordered_json::array();
  for (const CarveFault& f : r.faults)
    j["faults"].push_back({{"seed", f.seed}, {"tick", f.tick}, {"what", f.what}});
  return j;
}

nlohmann::ordered_json to_json(const TwoHandsPoint& p) {
  if (p.moves_away)
    return {{"body", p.body},
            {"hand", p.hand},
            {"other", p.other},
            {"moves_away", true},
            {"swing_um", rounded(1e6 * p.swing, 3)},
            {"made_uj", rounded(1e6 * p.made, 4)}};
  nlohmann::ordered_json j = {{"body", p.body},
                              {"hand", p.hand},
                              {"other", p.other},
                              {"default_n_m", rounded(p.ours.steady, 1)},
                              {"default_passive_n_m", rounded(p.ours.passive, 1)},
                              {"wall_n_m", rounded(p.wall.steady, 1)},
                              {"wall_passive_n_m", rounded(p.wall.passive, 1)},
                              {"wall_alike_n_m", rounded(p.alike.steady, 1)},
                              {"wall_alike_passive_n_m", rounded(p.alike.passive, 1)},
                              {"over_wall_alike", rounded(p.ours.steady / p.alike.steady, 3)},
                              {"over_wall_alike_passive", rounded(p.ours.passive / p.alike.passive, 3)},
                              {"over_wall", rounded(p.ours.steady / p.wall.steady, 3)},
                              {"over_wall_passive", rounded(p.ours.passive / p.wall.passive, 3)}};
  if (p.free.steady > 0) {
    j["free_n_m"] = rounded(p.free.steady, 1);
    j["free_passive_n_m"] = rounded(p.free.passive, 1);
  }
  return j;
}

nlohmann::ordered_json to_json(const LinkPoint& p) {
  return {
      {"delay_ms", rounded(1e3 * p.link.delay, 3)},
      {"jitter_ms", rounded(1e3 * p.link.jitter, 3)},
      {"loss", p.link.loss},
      {"energy_made_j", p.tanked.made_by_force},
      {"energy_made_untanked_j", p.bare.made_by_force},
      {"stiffness_n_per_m", rounded(std::min(p.displayed.steady, p.displayed.passive), 1)},
      {"steady_n_per_m", rounded(p.displayed.steady, 1)},
      {"stiffness_untanked_n_per_m", rounded(std::min(p.displayed_bare.steady, p.displayed_bare.passive), 1)},
      {"steady_untanked_n_per_m", rounded(p.displayed_bare.steady, 1)},
      {"tank", to_json(p.tanked)},
      {"no_tank", to_json(p.bare)}};
}

nlohmann::ordered_json to_json(const MentorPoint& p) {
  return {{"delay_ms", rounded(1e3 * p.link.delay, 3)},
          {"jitter_ms", rounded(1e3 * p.link.jitter, 3)},
          {"loss", p.link.loss},
          {"ghost", p.ghost},
          {"energy_made_j", p.tanked.made_by_force},
          {"energy_made_untanked_j", p.bare.made_by_force},
          {"energy_made_at_hand_j", p.tanked.made_at_hand},
          {"energy_made_at_hand_untanked_j", p.bare.made_at_hand},
          {"tank", to_json(p.tanked)},
          {"no_tank", to_json(p.bare)}};
}

}  // namespace

nlohmann::ordered_json to_json(const DdsPress& p) {
  return {{"force_scale", p.force_scale},
          {"displayed_n_m", rounded(p.displayed, 1)},
          {"ran", p.ran},
          {"swing_um", rounded(1e6 * p.swing, 2)},
          {"made_uj", rounded(1e6 * p.made, 3)},
          {"offline_swing_um", rounded(1e6 * p.offline_swing, 2)},
          {"offline_made_uj", rounded(1e6 * p.offline_made, 3)},
          {"round_trip_p99_us", rounded(p.round_trip_p99_us, 1)},
          {"round_trip_max_us", rounded(p.round_trip_max_us, 1)},
          {"unanswered_share", rounded(p.unanswered, 5)},
          {"status_seen_text", status_text(p.status)}};
}

nlohmann::ordered_json to_json(StabilityChart& chart, bool quick) {
  nlohmann::ordered_json json;
  json["command"] = "stability";
  json["quick"] = quick;
  chart.shard.prepare(
      json,
      {"map", "grasps", "random", "carve", "two_hands", "random_two", "random_cuts", "links", "mentors",
       "modes"},
      {"map", "grasps", "random", "carve", "two_hands", "random_two", "random_cuts", "links", "mentors"});
  for (const StiffnessPoint& p : chart.map) json["map"].push_back(to_json(p));
  for (const StiffnessPoint& p : chart.grasps) json["grasps"].push_back(to_json(p));
  for (const RandomReport& r : chart.random) json["random"].push_back(to_json(r));
  for (const CarveReport& r : chart.carve) json["carve"].push_back(to_json(r));
  for (const TwoHandsPoint& p : chart.two_hands) json["two_hands"].push_back(to_json(p));
  for (const RandomReport& r : chart.random_two) json["random_two"].push_back(to_json(r));
  for (const RandomReport& r : chart.random_cuts) json["random_cuts"].push_back(to_json(r));
  for (const LinkPoint& p : chart.links) json["links"].push_back(to_json(p));
  for (const MentorPoint& p : chart.mentors) json["mentors"].push_back(to_json(p));
  json["modes"] = nlohmann::ordered_json::array();
  for (const StabilityMode& m : chart.modes) json["modes"].push_back(to_json(m));
  chart.shard.note(json);
  return json;
}

}  // namespace hapticd
