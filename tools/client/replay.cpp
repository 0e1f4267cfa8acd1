// haptic replay: plays a recorded or scripted motion as a device.
#include <cmath>
#include <memory>

#include "server/record/bag_reader.h"
#include "server/record/trajectory_reader.h"
#include "server/scene/scene_reader.h"
#include "tools/cli/command.h"
#include "tools/client/recording.h"
#include "tools/client/replay_offline.h"
#include "tools/client/replay_schedule.h"
#include "tools/client/session.h"

namespace hapticd {
namespace {

constexpr double max_duration = 3600;  // [s]; every slot is kept in memory

struct ReplayOptions {
  SessionOptions session;
  std::string file;
  LengthUnit units = LengthUnit::metre;
  bool centre = false;
  double scale = 1;
  std::string topic;       // of a rosbag2 recording
  std::string from_scene;  // whose coordinates the file is in; empty: the device's
  bool offline = false;
  std::string scene, record, vtk, schedule;  // offline
  bool allow_refused = false;                // offline
  double speed = 1;
  bool no_enable = false;
};

class ReplaySource final : public SlotSource {
 public:
  ReplaySource(const Trajectory& trajectory, double speed) : trajectory_(trajectory), speed_(speed) {}

  DeviceCommand first() const noexcept override { return command_at(trajectory_.begin(), 0); }
  // A late slot sends the pose of its intended time, so that a stall of the client does not bend the motion.
  DeviceCommand at(std::int64_t k, std::int64_t, const NewestForce&, bool) noexcept override {
    // A quotient, so that a recording's own samples at whole milliseconds are met exactly.
    const double t = trajectory_.begin() + speed_ * (static_cast<double>(k) / 1e3);
    return command_at(t, buttons_at(trajectory_, t));
  }
  std::int64_t slots() const noexcept {
    return 1 + static_cast<std::int64_t>(
                   std::floor(1e3 * (trajectory_.end() - trajectory_.begin()) / speed_ + 1e-6));
  }

 private:
  DeviceCommand command_at(double t, std::uint32_t buttons) const noexcept {
    return {sample_at(trajectory_, t), buttons};
  }

  const Trajectory& trajectory_;
  double speed_;
};

Trajectory read(ReplayOptions& options, bool device_id_given) {
  Trajectory trajectory = is_bag(options.file) ? read_bag(options.file, options.topic, options.units)
                                               : read_trajectory(options.file, options.units);
  if (!options.from_scene.empty()) {
    const Scene scene = read_scene(options.from_scene);
    trajectory = from_scene(scene.device, trajectory);
    if (!device_id_given) options.session.client.device_id = scene.device.id;
  }
  if (options.centre) trajectory = centred(trajectory);
  return options.scale == 1 ? trajectory : scaled(trajectory, options.scale);
}

int replay_without_daemon(const ReplayOptions& options, ReplaySource& source, nlohmann::ordered_json& json,
                          Table& table) {
  const std::string file = options.scene.empty() ? options.from_scene : options.scene;
  if (file.empty()) throw UsageError("--offline needs a scene: --scene SCENE.yaml, or --from-scene");
  const Scene scene = read_scene(file);
  const bool done = run_offline_replay(
      scene, source, source.slots(),
      {options.session.forces, options.record, options.vtk, options.allow_refused}, json, table);
  if (!options.session.json.empty()) write_json(options.session.json, json);
  print(table);
  return done ? 0 : 1;
}

int reproduce(ReplayOptions& options) {
  if (!options.file.empty()) throw UsageError("a motion and --schedule: a schedule has its own");
  prepare(options.session, options.schedule);
  nlohmann::ordered_json json;
  json["command"] = "replay";
  json["file"] = options.schedule;
  Table table;
  const bool same = run_schedule_replay(options.schedule, options.scene, options.session.forces, json, table);
  if (!options.session.json.empty()) write_json(options.session.json, json);
  print(table);
  return same ? 0 : 1;
}

int replay(ReplayOptions& options, bool device_id_given) {
  if (!options.schedule.empty()) return reproduce(options);
  if (options.file.empty()) throw UsageError("FILE is required, or --offline --schedule FILE");
  const Trajectory trajectory = read(options, device_id_given);
  const double duration = (trajectory.end() - trajectory.begin()) / options.speed;
  if (duration > max_duration)
    throw UsageError(options.file + ": lasts " + fixed(duration, 0) + " s; at most " +
                     fixed(max_duration, 0) + " s can be replayed in one run");
  options.session.client.enable = !options.no_enable;
  prepare(options.session, options.file);
  OutputRule(options.session.force).require_folder_without("--vtk", options.vtk, "");

  ReplaySource source(trajectory, options.speed);
  nlohmann::ordered_json json;
  json["command"] = "replay";
  json["file"] = options.file;
  json["samples"] = trajectory.samples.size();
  json["duration_s"] = rounded(duration, 6);
  json["largest_speed_m_s"] = largest_speed(trajectory) * options.speed;
  Table table{{"recording", options.file + ", " + std::to_string(trajectory.samples.size()) + " samples, " +
                                fixed(duration, 1) + " s, at most " +
                                fixed(1e3 * largest_speed(trajectory) * options.speed, 1) + " mm/s"}};
  if (options.offline) return replay_without_daemon(options, source, json, table);
  Session session(options.session, source.slots());
  run(session, source, "replay");
  report(session, options.session, json, table);
  return finish(session, options.session, json, table);
}

}  // namespace

Command add_replay(CLI::App& application) {
  auto options = std::make_shared<ReplayOptions>();
  CLI::App* app = application.add_subcommand(
      "replay",
      "Plays a recording as a device at 1 kHz, by the file's own time stamps, and times the answers.");
  app->add_option("FILE", options->file,
                  "CSV: t,px,py,pz,qx,qy,qz,qw[,buttons]; or a rosbag2 directory or .db3")
      ->type_name("");
  app->add_option("--topic", options->topic, "of a rosbag2: which of its topics with poses");
  add_units_option(*app, options->units, "length unit of the file");
  CLI::Option* centre = app->add_flag("--centre,--center", options->centre,
                                      "put the recording's mean position at the device's origin");
  app->add_option("--scale", options->scale, "scale the positions, after centring")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app->add_option("--from-scene", options->from_scene,
                  "the file moves the instrument in this scene's coordinates: map it to the device's")
      ->type_name("SCENE.yaml")
      ->excludes(centre);
  app->add_option("--speed", options->speed, "play so many times as fast")
      ->check(CLI::Range(0.01, 100.0))
      ->capture_default_str();
  CLI::Option* no_enable = app->add_flag("--no-enable", options->no_enable, "do not ask for force");
  CLI::Option* offline =
      app->add_flag("--offline", options->offline,
                    "run the scene in here, without daemon and clock: two runs agree bit for bit, on one "
                    "machine; 1 if a state is refused")
          ->excludes(no_enable);
  app->add_option("--scene", options->scene, "offline: the scene to run, if not that of --from-scene")
      ->type_name("SCENE.yaml")
      ->needs(offline);
  app->add_option(
         "--schedule", options->schedule,
         "offline, in place of FILE: make the forces of a live run again (hapticd --schedule FILE); 1 "
         "if one differs by more than 1e-9 N")
      ->needs(offline);
  app->add_flag("--allow-refused", options->allow_refused,
                "offline: 0 even if states are faster than the device's max_speed and so refused")
      ->needs(offline);
  app->add_option("--record", options->record, "offline: write a rosbag2 recording")
      ->type_name("DIR")
      ->needs(offline);
  app->add_option("--vtk", options->vtk, "offline: write a series of the scene for ParaView, DIR/scene.pvd")
      ->type_name("DIR")
      ->needs(offline);
  add_session_options(*app, options->session);
  app->footer(
      "Positions are in the device's frame, as recorded, unless --centre, --scale or --from-scene map them.\n"
      "Example: haptic replay ../shared/data/trajectories/cataract_training_01.csv --json figures.json\n"
      "Example: haptic replay recording --offline --scene scene.yaml --forces forces.csv");
  return {app, [app, options] { return replay(*options, app->count("--device-id") > 0); }};
}

}  // namespace hapticd
