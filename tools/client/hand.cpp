// haptic hand: a simulated device and hand that close the loop with a running daemon.
#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <span>

#include "server/files/paths.h"
#include "server/files/usage.h"
#include "server/record/trajectory_reader.h"
#include "server/scene/device_reader.h"
#include "tools/cli/command.h"
#include "tools/client/hand_source.h"
#include "tools/client/joint_session.h"

namespace hapticd {
namespace {

struct HandOptions {
  SessionOptions session;
  HandSettings hand;
  double quantum_um = 0;
  double delay_ms = 0;
  int substeps = 10;
  std::string device;
  bool two = false;
  std::vector<std::string> targets;
  LengthUnit units = LengthUnit::metre;
  std::vector<double> press{0.005, 0.01, 1.0};
  std::vector<double> at{0, 0, 0};
  std::vector<double> direction{0, 0, -1};
  std::vector<double> orientation{0, 0, 0, 1};
  std::uint32_t buttons = 0;
  double duration = 0;  // 0: the script's own
};

struct TimedScript {
  HandScript script;
  double duration = 0;
};

// The numbers of hand i, of `size` numbers a hand; those that are given once are for each.
std::span<const double> numbers_of(const std::vector<double>& all, std::size_t i, std::size_t size) {
  return std::span(all).subspan(all.size() > size ? i * size : 0, size);
}

void check_numbers(const HandOptions& options, std::size_t hands) {
  const auto check = [hands](const char* name, const std::vector<double>& all, std::size_t size) {
    if (all.size() != size && all.size() != hands * size)
      throw UsageError(std::string(name) + ": " + std::to_string(size) + " numbers" +
                       (hands > 1 ? ", or as many for each hand" : ""));
  };
  check("--at", options.at, 3);
  check("--direction", options.direction, 3);
  check("--orientation", options.orientation, 4);
}

TimedScript press_script(const HandOptions& options, std::size_t i) {
  const auto vector = [i](const std::vector<double>& all) {
    const std::span<const double> v = numbers_of(all, i, 3);
    return Vec3(v[0], v[1], v[2]);
  };
  Press press;
  press.start = vector(options.at);
  press.direction = vector(options.direction);
  if (!(press.direction.norm() > 0)) throw UsageError("--direction: must not be zero");
  press.direction.normalize();
  press.depth = options.press[0];
  if (options.press.size() > 1) press.speed = options.press[1];
  if (options.press.size() > 2) press.hold = options.press[2];
  if (!(press.depth > 0 && press.speed > 0 && press.hold >= 0))
    throw UsageError("--press: depth and speed must be positive, hold not negative");
  DeviceCommand command;
  const std::span<const double> q = numbers_of(options.orientation, i, 4);
  command.pose.q = Quat(q[3], q[0], q[1], q[2]);
  if (std::abs(command.pose.q.norm() - 1) > 1e-2)
    throw UsageError("--orientation: must be a unit quaternion x,y,z,w");
  command.pose.q.normalize();
  command.buttons = options.buttons;
  const double pressed = press.depth / press.speed;
  return {{[press](double t) { return target_at(press, t); }, [command](double) { return command; },
           pressed + 0.5 * press.hold, pressed + press.hold},
          press.duration() + 0.5};
}

std::shared_ptr<const Trajectory> read_target(const HandOptions& options, std::size_t i) {
  return std::make_shared<const Trajectory>(read_trajectory(options.targets[i], options.units));
}

// begin: the file's time at the start.
TimedScript target_script(const std::shared_ptr<const Trajectory>& path, double begin) {
  HandScript script;
  script.target = [path, begin](double t) {
    constexpr double half = 5e-4;
    const Vec3 before = sample_at(*path, begin + t - half).p, after = sample_at(*path, begin + t + half).p;
    return HandTarget{sample_at(*path, begin + t).p, (after - before) / (2 * half)};
  };
  script.command = [path, begin](double t) {
    return DeviceCommand{sample_at(*path, begin + t), buttons_at(*path, begin + t)};
  };
  return {std::move(script), path->end() - begin};
}

void apply_device(HandOptions& options, const CLI::App& app) {
  if (options.device.empty()) return;
  const DeviceSettings limits = read_named_device(options.device, std::filesystem::current_path()).limits;
  if (app.count("--saturation") == 0) options.hand.saturation = limits.max_force;
  options.session.client.device_id = limits.id;
}

void report_hand(const HandOptions& options, const HandSource& source, double duration,
                 nlohmann::ordered_json& json, Table& table) {
  const HandFigures& f = source.figures();
  const double n = f.substeps > 0 ? static_cast<double>(f.substeps) : 1;
  const double force_rms = std::sqrt(f.force_square_sum / n), error_rms = std::sqrt(f.error_square_sum / n);
  const HandSettings& h = options.hand;
  json["duration_s"] = rounded(duration, 6);
  json["hand"] = {{"mass_kg", h.mass},         {"stiffness_n_m", h.stiffness},
                  {"damping_ns_m", h.damping}, {"device_damping_ns_m", h.device_damping},
                  {"friction_n", h.friction},  {"quantum_um", 1e6 * h.quantum},
                  {"delay_ms", 1e3 * h.delay}, {"saturation_n", h.saturation}};
  json["applied_force_peak_n"] = f.force_max;
  json["applied_force_rms_n"] = force_rms;
  json["position_error_rms_m"] = error_rms;
  json["position_error_max_m"] = f.error_max;
  // Diagonal of the box that x stays in while a press holds still, its second half.
  if (!f.rest.isEmpty()) json["swing_at_rest_m"] = f.rest.diagonal().norm();
  // Sign: energy that the server took in through the device's port; below zero it gave more than it took.
  json["energy_absorbed_j"] = f.passivity.energy;
  json["energy_absorbed_min_j"] = f.passivity.minimum;
  table.emplace_back("hand", fixed(h.mass, 3) + " kg, " + fixed(h.stiffness, 0) + " N/m, " + fixed(h.damping, 1) +
                                 " N·s/m, " + fixed(duration, 1) + " s");
  table.emplace_back("applied force",
                     "peak " + fixed(f.force_max, 4) + ", RMS " + fixed(force_rms, 4) + " N");
  table.emplace_back("hand off its target",
                     "RMS " + fixed(1e3 * error_rms, 3) + ", max " + fixed(1e3 * f.error_max, 3) + " mm");
  table.emplace_back("energy the server took in", fixed(1e3 * f.passivity.energy, 4) + " mJ, least " +
                                                      fixed(1e3 * f.passivity.minimum, 4) +
                                                      " mJ (below 0: it made energy)");
}

std::vector<TimedScript> scripts_of(const HandOptions& options, std::size_t hands) {
  std::vector<TimedScript> scripts;
  std::vector<std::shared_ptr<const Trajectory>> paths;
  for (std::size_t i = 0; i < options.targets.size(); ++i) paths.push_back(read_target(options, i));
  double begin = paths.empty() ? 0 : paths[0]->begin();
  for (const auto& path : paths) begin = std::min(begin, path->begin());
  for (std::size_t i = 0; i < hands; ++i)
    scripts.push_back(paths.empty() ? press_script(options, i) : target_script(paths[i], begin));
  return scripts;
}

int hand(HandOptions& options, const CLI::App& app) {
  apply_device(options, app);
  options.hand.quantum = 1e-6 * options.quantum_um;
  options.hand.delay = 1e-3 * options.delay_ms;
  try {
    check(options.hand);
  } catch (const std::invalid_argument& error) {
    throw UsageError(error.what());
  }
  const std::size_t hands = options.two ? 2 : 1;
  if (!options.targets.empty() && options.targets.size() != hands)
    throw UsageError("--target: one file a hand");
  check_numbers(options, hands);
  std::vector<TimedScript> scripts = scripts_of(options, hands);
  std::vector<std::string> inputs = options.targets;
  inputs.resize(hands);
  prepare(options.session, inputs);

  std::deque<HandSource> sources;
  std::vector<SlotSource*> played;
  std::vector<std::int64_t> slots;
  std::vector<double> duration;
  for (TimedScript& timed : scripts) {
    duration.push_back(options.duration > 0 ? options.duration : timed.duration);
    slots.push_back(1 + static_cast<std::int64_t>(std::floor(1e3 * duration.back() + 1e-6)));
    played.push_back(&sources.emplace_back(options.hand, std::move(timed.script), options.substeps));
  }
  nlohmann::ordered_json json;
  json["command"] = "hand";
  Table table;
  if (options.two) {
    JointSession session(options.session, hands, {});
    session.check_outputs(inputs);
    session.run(played, slots, "hands");
    return session.finish(json, table, [&](std::size_t i, nlohmann::ordered_json& of, Table& rows) {
      report_hand(options, sources[i], duration[i], of, rows);
    });
  }
  Session session(options.session, slots[0]);
  run(session, options.session, sources[0], "hand");
  report_hand(options, sources[0], duration[0], json, table);
  report(session, options.session, json, table);
  return finish(session, options.session, json, table);
}

}  // namespace

Command add_hand(CLI::App& application) {
  auto options = std::make_shared<HandOptions>();
  CLI::App* app = application.add_subcommand(
      "hand",
      "A simulated hand on a simulated device: mass, damping and a spring to a target, closed over DDS.");
  const auto number = [&](const char* name, double& value, const char* text) {
    app->add_option(name, value, text)->check(not_negative)->capture_default_str();
  };
  number("--mass", options->hand.mass, "of hand and device at the stylus [kg]");
  number("--stiffness", options->hand.stiffness, "of the grip [N/m]");
  number("--damping", options->hand.damping, "of the grip [N·s/m]");
  number("--device-damping", options->hand.device_damping, "of the mechanism [N·s/m]");
  number("--friction", options->hand.friction, "Coulomb friction of the mechanism [N]");
  number("--quantum", options->quantum_um, "encoder resolution [µm], 0: continuous");
  number("--delay", options->delay_ms, "from a force's arrival to its effect [ms]");
  number("--saturation", options->hand.saturation, "largest force of the motors [N], 0: unlimited");
  app->add_option("--device", options->device, "saturation and id of this device (config/devices)")
      ->type_name("NAME|FILE");
  app->add_flag("--two", options->two,
                "two hands at once, with the devices of the scene's first two instruments, or --device-id ID,ID");
  CLI::Option* target = app->add_option("--target", options->targets, "the hand follows this CSV; two: one each")
                            ->expected(1, 2)
                            ->type_name("FILE");
  add_units_option(*app, options->units, "length unit of the target file");
  app->add_option("--press", options->press, "the hand presses: depth [m], speed [m/s], hold [s]")
      ->delimiter(',')
      ->expected(1, 3)
      ->excludes(target)
      ->type_name("DEPTH[,SPEED[,HOLD]]");
  app->add_option("--at", options->at, "where a press begins, device frame [m]; of two hands the same, or six numbers")
      ->delimiter(',')
      ->expected(3, 6)
      ->type_name("X,Y,Z");
  app->add_option("--direction", options->direction, "of a press, device frame; as --at")
      ->delimiter(',')
      ->expected(3, 6)
      ->type_name("X,Y,Z");
  app->add_option("--orientation", options->orientation, "of the stylus in a press; as --at")
      ->delimiter(',')
      ->expected(4, 8)
      ->type_name("QX,QY,QZ,QW");
  app->add_option("--buttons", options->buttons, "held in a press; 1: phaco pedal, 2: aspiration, 3: both");
  app->add_option("--substeps", options->substeps, "integration steps per millisecond")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app->add_option("--duration", options->duration, "of the run [s], default: the script's")
      ->check(CLI::Range(0.001, 3600.0));
  add_session_options(*app, options->session);
  app->footer(
      "Energy is counted at the device's port and positive where the server took it in.\n"
      "Example: haptic hand --two --target sculpt.csv hold.csv --device touch --json figures.json\n"
      "Example: haptic hand --device touch --at 0,0,0.03 --press 0.01,0.02,1 --quantum 55 --json "
      "figures.json");
  return {app, [app, options] { return hand(*options, *app); }};
}

}  // namespace hapticd
