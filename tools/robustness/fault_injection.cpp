// haptic abuse: every attack (attack.h) on a daemon, one after another and all at once, under a client that
// behaves. With two hands the attacked device is its neighbour in the same tissue, first the one and then the
// other.
#include <signal.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>

#include "haptic/clock.h"
#include "server/files/paths.h"
#include "server/scene/scene_reader.h"
#include "tools/cli/child.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/client/session.h"
#include "tools/robustness/attack.h"
#include "tools/robustness/stage_figures.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double quiet_seconds = 1.5, together_factor = 2;

struct AbuseOptions {
  double seconds = 2;
  std::string json, attack, mode = "tick";
  bool force = false;
  int hands = 1;
  AttackTarget target;
};

// Down onto the cube in a second, then still.
class ContactSource final : public SlotSource {
 public:
  DeviceCommand first() const noexcept override { return at_height(0.0300); }
  DeviceCommand at(std::int64_t k, std::int64_t, const NewestForce&, bool) noexcept override {
    return at_height(0.0300 - 0.0085 * std::min(1.0, 1e-3 * static_cast<double>(k)));
  }

 private:
  static DeviceCommand at_height(double z) noexcept {
    DeviceCommand c;
    c.pose.p.z() = z;
    return c;
  }
};

std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<std::string> daemon_command(const AbuseOptions& options, const Scene& scene,
                                        const fs::path& figures) {
  std::vector<std::string> command = {beside_this_program("hapticd"),
                                      scene.file.string(),
                                      "--test-hooks",
                                      "--mode",
                                      options.mode,
                                      "--domain",
                                      std::to_string(options.target.domain),
                                      "--json",
                                      figures.string()};
  if (options.hands == 1) command.insert(command.end(), {"--also", "touch"});
  return command;
}

// One device's figures in the daemon's summary, which has the first one's at the top.
const nlohmann::json& figures_of(const nlohmann::json& daemon, std::uint32_t device) {
  if (daemon.at("device_id") != device)
    for (const nlohmann::json& other : daemon.at("more_devices"))
      if (other.at("device_id") == device) return other;
  return daemon;
}

// Under one client that behaves.
class Abuse {
 public:
  Abuse(const AbuseOptions& options, const Scene& scene, const fs::path& scratch)
      : options_(options),
        scene_(scene),
        daemon_({.command = daemon_command(options, scene, scratch / "hapticd.json"),
                 .output = (scratch / "hapticd.log").string()}),
        figures_(scratch / "hapticd.json"),
        log_(scratch / "hapticd.log") {
    for (int i = 0; i < 300 && daemon_.running() && text_of(log_).find("ready") == std::string::npos; ++i)
      usleep(100'000);
    if (text_of(log_).find("ready") == std::string::npos)
      throw std::runtime_error("hapticd did not start: " + text_of(log_));
  }

  // The report; it ends with the verdict.
  Json run();

 private:
  void stages();
  void quiet() { usleep(static_cast<useconds_t>(1e6 * quiet_seconds)); }
  ChildSettings attacker(const std::string& name, double seconds) const {
    char text[32];
    std::snprintf(text, sizeof text, "%.3f", seconds);
    return {.command = {beside_this_program("haptic"), "abuse", "--attack", name, "--seconds", text,
                        "--domain", std::to_string(options_.target.domain), "--attacked",
                        std::to_string(options_.target.own)}};
  }
  template <typename F>
  void stage(const std::string& name, bool held, F&& f) {
    if (interrupted()) return;
    Stage s{name, monotonic_ns(), 0, held};
    f();
    usleep(200'000);  // what the attack leaves behind belongs to it
    s.end_ns = monotonic_ns();
    stages_.push_back(s);
  }
  void alone(const std::string& name) {
    stage(name, false, [&] {
      Child child(attacker(name, options_.seconds));
      child.wait(options_.seconds + 10);
    });
  }
  void stopped_and_continued(double seconds) {
    Child child(attacker("dying", seconds));
    usleep(static_cast<useconds_t>(3e5 * seconds));
    child.signal(SIGSTOP);
    usleep(300'000);
    child.signal(SIGCONT);
    child.wait(seconds + 10);
  }
  void killed(double seconds) {
    Child child(attacker("dying", seconds + 10));
    usleep(static_cast<useconds_t>(1e6 * seconds));
    child.signal(SIGKILL);
    child.wait(5);
  }
  void held(int milliseconds) {
    daemon_.signal(SIGRTMIN, milliseconds);
    usleep(static_cast<useconds_t>(1000 * milliseconds + 600'000));
  }
  Json report(const Session& session, const WatchedMachine& machine);

  const AbuseOptions options_;
  const Scene& scene_;
  Child daemon_;
  fs::path figures_, log_;
  std::vector<Stage> stages_;
  double other_force_max_ = 0;  // the attackers' own device's
  bool other_finite_ = true;
};

void Abuse::stages() {
  stage("none", false, [this] { quiet(); });
  for (const std::string& name : attacks())
    if (name != "dying") alone(name);
  stage("killed", false, [this] { killed(options_.seconds / 2); });
  stage("stopped and continued", false, [this] { stopped_and_continued(options_.seconds); });
  for (const int ms : {20, 100, 500})
    stage("simulation held " + std::to_string(ms) + " ms", true, [this, ms] { held(ms); });
  stage("all at once", true, [this] {
    const double seconds = together_factor * options_.seconds;
    std::vector<std::unique_ptr<Child>> children;
    for (const std::string& name : attacks())
      children.push_back(std::make_unique<Child>(attacker(name, seconds)));
    std::thread killing([&] { killed(seconds / 2); });
    std::thread stopping([&] { stopped_and_continued(seconds); });
    for (const int ms : {20, 100, 500}) held(ms);
    killing.join();
    stopping.join();
    for (const auto& child : children) child->wait(seconds + 10);
  });
  stage("none, after", false, [this] { quiet(); });
}

Json Abuse::run() {
  SessionOptions options;
  options.client.domain = options_.target.domain;
  options.client.device_id = options_.target.behaving;
  // Slots for stages that all last as long as they may; the run ends when they do.
  const double longest_stage = together_factor * options_.seconds + 11;
  const double bound = 30 + static_cast<double>(attacks().size() + 8) * longest_stage;
  Session session(options, static_cast<std::int64_t>(1e3 * bound));
  Reader<hapticd_msg_ForceCommand> forces(session.participant);
  ContactSource source;
  std::atomic<bool> over{false};
  std::thread attacking;
  std::exception_ptr failure;
  StallWatch watch;
  try {
    session.client.run(source, [&](std::int64_t reached) {
      forces.take_each([&](const hapticd_msg_ForceCommand& m, const dds_sample_info_t&) {
        if (m.device_id != options_.target.own) return;
        const Vec3 f(m.force[0], m.force[1], m.force[2]);
        other_finite_ = other_finite_ && f.allFinite();
        other_force_max_ = std::max(other_force_max_, f.norm());
      });
      if (reached >= 2000 && !attacking.joinable())
        attacking = std::thread([&] {
          stages();
          over = true;
          session.client.leave();
        });
    });
  } catch (...) {
    failure = std::current_exception();
  }
  if (attacking.joinable()) attacking.join();
  if (failure) std::rethrow_exception(failure);
  if (!over) throw std::runtime_error("interrupted");
  return report(session, watch.stop());
}

Json Abuse::report(const Session& session, const WatchedMachine& machine) {
  const bool alive = daemon_.running();
  daemon_.signal(SIGTERM);
  const bool ended_well = daemon_.wait(5) == 0;
  // Both devices have the same limits.
  const double maximum = scene_.first().device.max_force, step = 1e-3 * scene_.first().device.max_force_rate;
  bool good = alive && ended_well && other_finite_ && other_force_max_ <= maximum * (1 + 1e-9);
  Json j, list = Json::array();
  Table table;
  for (const Stage& s : stages_) {
    const StageFigures f = figures_of(session.client, s, machine.stalls);
    const bool kept = f.kept(s.held, maximum, step);
    good = good && kept;
    list.push_back(to_json(s, f, kept));
    table.emplace_back((kept ? "ok    " : "FAIL  ") + s.name, to_text(f));
  }
  const nlohmann::json daemon = nlohmann::json::parse(text_of(figures_), nullptr, false);
  j["command"] = "abuse";
  j["mode"] = options_.mode;
  j["device_id"] = options_.target.behaving;
  j["realtime"] = session.client.grant().granted;
  j["stages"] = list;
  j["machine_stalls"] = to_json(machine);
  j["force_limit_n"] = maximum;
  j["step_limit_n"] = step;
  j["attacked_device_force_max_n"] = other_force_max_;
  j["daemon_survived"] = alive && ended_well;
  if (daemon.is_object()) {
    const nlohmann::json& own = figures_of(daemon, options_.target.behaving);
    j["conflicts"] = own.value("conflicts", 0);
    j["wake_us"] = own.at("wake_us");
    j["allocations_in_haptic_code"] = daemon.value("allocations_in_haptic_code", -1);
    j["allocations_in_device_port"] = daemon.value("allocations_in_device_port", -1);
    j["page_faults"] = own.value("page_faults", -1);
    j["states_rejected_of_the_attacked"] = figures_of(daemon, options_.target.own).at("states_rejected");
  }
  j["verdict"] = good ? "pass" : "fail";
  table.emplace_back("the machine stood still", to_text(machine));
  table.emplace_back("the attacked device", fixed(other_force_max_, 3) + " N at most");
  table.emplace_back("daemon", alive && ended_well ? "alive to the end" : "DIED");
  if (options_.hands > 1)
    std::printf("device %u, attacked: device %u\n", options_.target.behaving, options_.target.own);
  print(table);
  return j;
}

Json abuse_either(AbuseOptions options, const Scene& scene, const fs::path& scratch) {
  Json j{{"command", "abuse"}, {"mode", options.mode}, {"hands", 2}, {"devices", Json::array()}};
  bool good = true;
  for (int behaving = 0; behaving < 2; ++behaving) {
    options.target.behaving = scene.instruments[static_cast<std::size_t>(behaving)].device.id;
    options.target.own = scene.instruments[static_cast<std::size_t>(1 - behaving)].device.id;
    j["devices"].push_back(Abuse(options, scene, scratch).run());
    good = good && j["devices"].back().at("verdict") == "pass";
    fs::remove(scratch / "hapticd.log");  // it tells when the next daemon is ready
  }
  j["verdict"] = good ? "pass" : "fail";
  return j;
}

int abuse(AbuseOptions options) {
  options.target.behaving = options.target.own == 0 ? 1 : 0;
  if (!options.attack.empty()) {
    attack(options.attack, options.seconds, options.target);
    return 0;
  }
  OutputRule(options.force).require_figures("--json", options.json);
  const Scene scene =
      read_scene(config_directory() / "scenes/cube" / (options.hands > 1 ? "two_hands.yaml" : "cube.yaml"));
  const fs::path scratch = fs::temp_directory_path() / ("haptic-abuse-" + std::to_string(getpid()));
  fs::create_directories(scratch);
  const std::unique_ptr<const fs::path, void (*)(const fs::path*)> gone(&scratch, [](const fs::path* p) {
    std::error_code e;
    fs::remove_all(*p, e);
  });
  const Json j =
      options.hands > 1 ? abuse_either(options, scene, scratch) : Abuse(options, scene, scratch).run();
  if (!options.json.empty()) write_json(options.json, j);
  const std::string verdict = j.at("verdict");
  std::printf("verdict: %s\n", verdict.c_str());
  return verdict == "pass" ? 0 : 1;
}

}  // namespace

Command add_abuse(CLI::App& application) {
  auto options = std::make_shared<AbuseOptions>();
  CLI::App* app = application.add_subcommand(
      "abuse", "Attacks a daemon of its own in every way there is, under a client that behaves.");
  app->add_option("--seconds", options->seconds, "for each attack [s]")
      ->check(CLI::Range(0.2, 60.0))
      ->capture_default_str();
  app->add_option("--mode", options->mode, "of the daemon")
      ->check(CLI::IsMember({"tick", "event"}))
      ->capture_default_str();
  app->add_option("--hands", options->hands,
                  "2: in one tissue; either is attacked, and the other one watched")
      ->check(CLI::Range(1, 2))
      ->capture_default_str();
  app->add_option("--domain", options->target.domain, "DDS domain")
      ->check(CLI::Range(0u, 230u))
      ->capture_default_str();
  app->add_option("--json", options->json, "write the figures to this file")->type_name("FILE");
  add_force_option(*app, options->force);
  app->add_option("--attack", options->attack,
                  "only this one, on the daemon that runs in --domain (attack.h)")
      ->check(CLI::IsMember(attacks()));
  app->add_option("--attacked", options->target.own, "with --attack: the attackers' own device")
      ->check(CLI::Range(0u, 1u))
      ->capture_default_str();
  app->footer(
      "Example: haptic abuse --seconds 2 --json abuse.json\n"
      "Exit code 0 only if the well-behaved client's force stayed bounded and its slots answered "
      "throughout, but for those that a stall of the machine itself struck.");
  return {app, [options] { return abuse(*options); }};
}

}  // namespace hapticd
