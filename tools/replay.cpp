// haptic replay: plays a recorded or scripted motion as a device.
#include <cmath>
#include <memory>

#include "server/scene_reader.h"
#include "server/trajectory_reader.h"
#include "tools/command.h"
#include "tools/recording.h"
#include "tools/session.h"

namespace hapticd {
namespace {

constexpr double max_duration = 3600;  // [s]; every slot is kept in memory

struct ReplayOptions {
  SessionOptions session;
  std::string file;
  LengthUnit units = LengthUnit::metre;
  bool centre = false;
  double scale = 1;
  std::string scene;
  double speed = 1;
  bool no_enable = false;
};

class ReplaySource final : public SlotSource {
 public:
  ReplaySource(const Trajectory& trajectory, double speed) : trajectory_(trajectory), speed_(speed) {}

  DeviceCommand first() const noexcept override { return command_at(trajectory_.begin(), 0); }
  // A late slot sends the pose of its intended time, so that a stall of the client does not bend the motion.
  DeviceCommand at(std::int64_t k, std::int64_t, const NewestForce&, bool) noexcept override {
    const double t = trajectory_.begin() + speed_ * 1e-3 * static_cast<double>(k);
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
  Trajectory trajectory = read_trajectory(options.file, options.units);
  if (!options.scene.empty()) {
    const Scene scene = read_scene(options.scene);
    trajectory = from_scene(scene.device, trajectory);
    if (!device_id_given) options.session.client.device_id = scene.device.id;
  }
  if (options.centre) trajectory = centred(trajectory);
  return options.scale == 1 ? trajectory : scaled(trajectory, options.scale);
}

int replay(ReplayOptions& options, bool device_id_given) {
  const Trajectory trajectory = read(options, device_id_given);
  const double duration = (trajectory.end() - trajectory.begin()) / options.speed;
  if (duration > max_duration)
    throw UsageError(options.file + ": lasts " + fixed(duration, 0) + " s; at most " +
                     fixed(max_duration, 0) + " s can be replayed in one run");
  options.session.client.enable = !options.no_enable;
  prepare(options.session);

  ReplaySource source(trajectory, options.speed);
  Session session(options.session, source.slots());
  run(session, source, "replay");

  nlohmann::ordered_json json;
  json["command"] = "replay";
  json["file"] = options.file;
  json["samples"] = trajectory.samples.size();
  json["duration_s"] = rounded(duration, 6);
  json["largest_speed_m_s"] = largest_speed(trajectory) * options.speed;
  Table table{{"recording", options.file + ", " + std::to_string(trajectory.samples.size()) + " samples, " +
                                fixed(duration, 1) + " s, at most " +
                                fixed(1e3 * largest_speed(trajectory) * options.speed, 1) + " mm/s"}};
  report(session, options.session, json, table);
  return finish(session, options.session, json, table);
}

}  // namespace

Command add_replay(CLI::App& application) {
  auto options = std::make_shared<ReplayOptions>();
  CLI::App* app = application.add_subcommand(
      "replay",
      "Plays a CSV recording as a device at 1 kHz, by the file's own time stamps, and times the answers.");
  app->add_option("FILE", options->file, "CSV: t,px,py,pz,qx,qy,qz,qw[,buttons]")->required()->type_name("");
  add_units_option(*app, options->units, "length unit of the file");
  CLI::Option* centre = app->add_flag("--centre,--center", options->centre,
                                      "put the recording's mean position at the device's origin");
  app->add_option("--scale", options->scale, "scale the positions, after centring")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app->add_option("--from-scene", options->scene,
                  "the file moves the instrument in this scene's coordinates: map it to the device's")
      ->type_name("SCENE.yaml")
      ->excludes(centre);
  app->add_option("--speed", options->speed, "play so many times as fast")
      ->check(CLI::Range(0.01, 100.0))
      ->capture_default_str();
  app->add_flag("--no-enable", options->no_enable, "do not ask for force");
  add_session_options(*app, options->session);
  app->footer(
      "Positions are in the device's frame, as recorded, unless --centre, --scale or --from-scene map them.\n"
      "Example: haptic replay ../shared/data/trajectories/cataract_training_01.csv --json figures.json");
  return {app, [app, options] { return replay(*options, app->count("--device-id") > 0); }};
}

}  // namespace hapticd
