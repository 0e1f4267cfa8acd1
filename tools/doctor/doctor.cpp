#include "tools/doctor/doctor.h"

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "server/os/realtime.h"
#include "server/plan/plan.h"
#include "server/scene/scene_describe.h"
#include "server/scene/scene_reader.h"
#include "tools/cli/command.h"
#include "tools/cli/report.h"

namespace hapticd {
namespace {

const char* word(Health h) { return h == Health::pass ? "pass" : h == Health::warn ? "warn" : "FAIL"; }

struct DoctorOptions {
  std::string scene, device, secure, json;
  bool force = false;
  std::uint32_t domain = 229;
  double answer_dds = 0;
  std::optional<std::uint32_t> running;
};

// "touch", or "phaco (touch, id 0) and chopper (touch, id 1)".
std::string devices_in_words(const Scene& scene) {
  if (scene.instruments.size() == 1) return scene.first().device_name;
  std::string text;
  for (std::size_t i = 0; i < scene.instruments.size(); ++i) {
    const SceneInstrument& held = scene.instruments[i];
    text += (i == 0 ? "" : i + 1 == scene.instruments.size() ? " and " : ", ") + held.name + " (" +
            held.device_name + ", id " + std::to_string(held.device.id) + ")";
  }
  return text + " in one tissue, solved together by one haptic thread";
}

Finding stiffness_of(const SceneInstrument& held, bool one) {
  const double stiffness = felt_stiffness(held);
  Finding felt{one ? "stiffness" : "stiffness " + held.name, Health::pass,
               "at most " + fixed(stiffness, 0) + " N/m at the hand (coupling × scales) of " +
                   fixed(held.device_stiffness, 0) + " that " + held.device_name + " displays stably",
               ""};
  if (stiffness > 1.001 * held.device_stiffness) {
    felt.health = Health::warn;
    felt.fix = "less mapping.force_scale or instrument.coupling.stiffness";
  }
  return felt;
}

int doctor(const DoctorOptions& o) {
  if (o.answer_dds > 0) return answer_dds(o.domain, o.answer_dds);
  OutputRule(o.force).require_figures("--json", o.json);
  std::vector<Finding> all = check_machine();
  const auto add = [&](std::vector<Finding> more) { all.insert(all.end(), more.begin(), more.end()); };
  add({check_dds(o.domain)});
  if (!o.secure.empty()) add(check_security(o.secure));
  if (!o.scene.empty()) add(check_scene(o.scene, o.device));
  if (o.running) {
    std::optional<Security> keys;
    if (!o.secure.empty()) keys = security_files(o.secure, "operator");
    add(check_daemon(*o.running, keys));
  }
  std::fputs(to_text(all).c_str(), stdout);
  if (!o.json.empty()) write_json(o.json, to_json(all));
  return worst(all) == Health::fail ? 1 : 0;
}

}  // namespace

std::vector<Finding> check_scene(const std::string& file, const std::string& device) {
  try {
    const Scene scene = read_scene(file, device);
    keep_malloc_pages();
    const Plan plan = make_plan(scene);
    const double period = 1e3 / scene.rate;
    Finding read{
        "scene", Health::pass,
        file + ": read, with " + std::to_string(scene.bodies.size()) + " bodies for " + devices_in_words(scene),
        ""};
    Finding time{"time", Health::pass,
                 "9 of 10 steps under " + fixed(plan.step_ms, 1) + " ms of " + fixed(period, 1) +
                     ", a tick " + fixed(plan.tick_ms, 2) + " ms",
                 ""};
    if (!plan.on_time) {
      time.health = Health::warn;
      time.fix = "a coarser mesh, simulation.compliance: zone, model: auto, or a lower simulation.rate";
    }
    std::vector<Finding> out = {read, time};
    for (const SceneInstrument& held : scene.instruments)
      out.push_back(stiffness_of(held, scene.instruments.size() == 1));
    if (scene.plans && !plan.met)
      out.push_back({"accuracy", Health::warn,
                     "the plan's force error is " + fixed(100 * plan.error_estimate, 1) + " % of " +
                         fixed(100 * scene.accuracy, 1),
                     "a higher simulation.rate, or a larger accuracy in the scene"});
    return out;
  } catch (const std::exception& e) {
    return {{"scene", Health::fail, e.what(),
             "hapticd SCENE --check names file, line and key; config/README.md the keys"}};
  }
}

Health worst(const std::vector<Finding>& findings) {
  Health w = Health::pass;
  for (const Finding& f : findings) w = std::max(w, f.health);
  return w;
}

std::string to_text(const std::vector<Finding>& findings) {
  std::string text;
  std::size_t width = 0;
  for (const Finding& f : findings) width = std::max(width, f.name.size());
  int warnings = 0, failures = 0;
  for (const Finding& f : findings) {
    text += std::string(word(f.health)) + "  " + f.name + std::string(width - f.name.size() + 2, ' ') +
            f.found + "\n";
    if (!f.fix.empty()) text += std::string(width + 8, ' ') + "→ " + f.fix + "\n";
    warnings += f.health == Health::warn;
    failures += f.health == Health::fail;
  }
  const int passed = static_cast<int>(findings.size()) - warnings - failures;
  return text + std::to_string(passed) + " pass, " + std::to_string(warnings) + " warn, " +
         std::to_string(failures) + " fail\n";
}

nlohmann::ordered_json to_json(const std::vector<Finding>& findings) {
  nlohmann::ordered_json json;
  json["command"] = "doctor";
  json["verdict"] = worst(findings) == Health::pass   ? "pass"
                    : worst(findings) == Health::warn ? "warn"
                                                      : "fail";
  nlohmann::ordered_json& list = json["checks"] = nlohmann::ordered_json::array();
  for (const Finding& f : findings) {
    const char* health = f.health == Health::pass ? "pass" : f.health == Health::warn ? "warn" : "fail";
    list.push_back({{"name", f.name}, {"verdict", health}, {"found", f.found}, {"fix", f.fix}});
  }
  return json;
}

Command add_doctor(CLI::App& application) {
  auto options = std::make_shared<DoctorOptions>();
  CLI::App* app = application.add_subcommand(
      "doctor", "Whether this machine can serve a scene; the fix for what it cannot.");
  app->add_option("scene", options->scene, "read, checked and timed as well")->type_name("SCENE.yaml");
  app->add_option("--device", options->device, "device file or name that replaces the scene's");
  app->add_option("--secure", options->secure, "check these keys as well")->type_name("DIR");
  app->add_option("--domain", options->domain, "DDS domain to try, one that nobody uses")
      ->check(CLI::Range(0u, 230u))
      ->capture_default_str();
  app->add_option("--running", options->running,
                  "look at the daemon of this DDS domain too: its instruments, their devices and clients")
      ->check(CLI::Range(0u, 230u))
      ->type_name("DOMAIN");
  app->add_option("--json", options->json, "write the findings to this file")->type_name("FILE");
  add_force_option(*app, options->force);
  app->add_option("--answer-dds", options->answer_dds)->group("");
  app->footer(
      "Example: haptic doctor config/scenes/cube/cube.yaml\n"
      "Example: haptic doctor --running 0\n"
      "Exit code 0: all passed, or warnings alone; 1: something failed.");
  return {app, [options] { return doctor(*options); }};
}

}  // namespace hapticd
