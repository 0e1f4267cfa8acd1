// haptic replay: plays a recorded or scripted motion as a device.
#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <optional>

#include "server/files/usage.h"
#include "server/record/bag_reader.h"
#include "server/record/trajectory_reader.h"
#include "server/scene/scene_reader.h"
#include "tools/cli/command.h"
#include "tools/client/joint_session.h"
#include "tools/client/recording.h"
#include "tools/client/replay_offline.h"
#include "tools/client/replay_schedule.h"
#include "tools/client/session.h"

namespace hapticd {
namespace {

constexpr double max_duration = 3600;  // [s]; every slot is kept in memory

struct ReplayOptions {
  SessionOptions session;
  std::vector<std::string> files;
  LengthUnit units = LengthUnit::metre;
  bool centre = false;
  double scale = 1;
  std::string topic;       // of a rosbag2 recording
  std::string from_scene;  // whose coordinates the file is in; empty: the device's
  bool offline = false;
  std::string scene, record, vtk, schedule;  // offline
  bool allow_refused = false;                // offline
  double late = 0;                           // offline; spread of the steps' time, 0: none
  std::uint64_t late_seed = 1;               // offline
  std::vector<double> pivot;                 // offline; scene [m]
  double speed = 1;
  bool no_enable = false;
};

class ReplaySource final : public SlotSource {
 public:
  ReplaySource(const Trajectory& trajectory, double speed)
      : ReplaySource(trajectory, speed, trajectory.begin()) {}
  // begin: the file's time in slot 0.
  ReplaySource(const Trajectory& trajectory, double speed, double begin)
      : trajectory_(trajectory), speed_(speed), begin_(begin) {}

  DeviceCommand first() const noexcept override { return command_at(begin_, 0); }
  // A late slot sends the pose of its intended time, so that a stall of the client does not bend the motion.
  DeviceCommand at(std::int64_t k, std::int64_t, const NewestForce&, bool) noexcept override {
    // A quotient, so that a recording's own samples at whole milliseconds are met exactly.
    const double t = begin_ + speed_ * (static_cast<double>(k) / 1e3);
    return command_at(t, buttons_at(trajectory_, t));
  }
  std::int64_t slots() const noexcept {
    return 1 + static_cast<std::int64_t>(std::floor(1e3 * (trajectory_.end() - begin_) / speed_ + 1e-6));
  }

 private:
  DeviceCommand command_at(double t, std::uint32_t buttons) const noexcept {
    return {sample_at(trajectory_, t), buttons};
  }

  const Trajectory& trajectory_;
  double speed_, begin_;
};

// device: whose scene the file's coordinates are; null: the file's are the device's.
Trajectory read(const ReplayOptions& options, const std::string& file, const DeviceSettings* device) {
  Trajectory trajectory =
      is_bag(file) ? read_bag(file, options.topic, options.units) : read_trajectory(file, options.units);
  if (device) trajectory = from_scene(*device, trajectory);
  if (options.centre) trajectory = centred(trajectory);
  return options.scale == 1 ? trajectory : scaled(trajectory, options.scale);
}

int reproduce(ReplayOptions& options) {
  if (!options.files.empty()) throw UsageError("a motion and --schedule: a schedule has its own");
  prepare(options.session, {options.schedule});
  nlohmann::ordered_json json;
  json["command"] = "replay";
  json["file"] = options.schedule;
  Table table;
  const bool same = run_schedule_replay(options.schedule, options.scene, options.session.forces, json, table);
  if (!options.session.json.empty()) write_json(options.session.json, json);
  print(table);
  return same ? 0 : 1;
}

// Returns the duration.
double checked_duration(const std::string& file, double duration) {
  if (duration > max_duration)
    throw UsageError(file + ": lasts " + fixed(duration, 0) + " s; at most " + fixed(max_duration, 0) +
                     " s can be replayed in one run");
  return duration;
}

void describe(const std::string& file, const Trajectory& trajectory, double speed, double duration,
              nlohmann::ordered_json& json, Table& table) {
  json["file"] = file;
  json["samples"] = trajectory.samples.size();
  json["duration_s"] = rounded(duration, 6);
  json["largest_speed_m_s"] = largest_speed(trajectory) * speed;
  table.emplace_back("recording", file + ", " + std::to_string(trajectory.samples.size()) + " samples, " +
                                      fixed(duration, 1) + " s, at most " +
                                      fixed(1e3 * largest_speed(trajectory) * speed, 1) + " mm/s");
}

// Motions on one time axis.
struct Motions {
  std::vector<Trajectory> of;  // device
  double begin = 0, end = 0;   // of the earliest, of the latest [s]
};

// scene: whose coordinates the files are in; null: the devices'.
Motions read_all(const ReplayOptions& options, const std::vector<std::string>& files, const Scene* scene) {
  if (scene && scene->instruments.size() < files.size())
    throw UsageError(options.from_scene + ": has fewer instruments than there are recordings");
  Motions motions;
  for (std::size_t i = 0; i < files.size(); ++i)
    motions.of.push_back(read(options, files[i], scene ? &scene->instruments[i].device : nullptr));
  motions.begin = motions.of[0].begin();
  motions.end = motions.of[0].end();
  for (const Trajectory& m : motions.of) {
    motions.begin = std::min(motions.begin, m.begin());
    motions.end = std::max(motions.end, m.end());
  }
  return motions;
}

std::optional<Scene> mapping(const ReplayOptions& options) {
  if (options.from_scene.empty()) return std::nullopt;
  return read_scene(options.from_scene);
}

// The recordings in the order of the scene's instruments, or without any the scene's own.
std::vector<std::string> offline_files(const ReplayOptions& options, const Scene& scene) {
  std::vector<std::string> files = options.files;
  if (files.size() > scene.instruments.size())
    throw UsageError(std::to_string(files.size()) + " recordings for " +
                     std::to_string(scene.instruments.size()) + " instruments: at most one for each");
  if (!files.empty()) return files;
  for (const SceneInstrument& held : scene.instruments) {
    if (!held.trajectory)
      throw UsageError(scene.file.string() + ": '" + held.name +
                       "' has no trajectory: name a FILE for each instrument");
    files.push_back(held.trajectory->string());
  }
  return files;
}

int replay_without_daemon(ReplayOptions& options) {
  const std::string file = options.scene.empty() ? options.from_scene : options.scene;
  if (file.empty()) throw UsageError("--offline needs a scene: --scene SCENE.yaml, or --from-scene");
  Scene scene = read_scene(file);
  if (!options.pivot.empty()) {
    DeviceSettings& device = scene.first().device;
    const Vec3 point(options.pivot[0], options.pivot[1], options.pivot[2]), out = point - device.origin;
    if (out.isZero(0)) throw UsageError("--pivot: is the scene's mapping.origin");
    device.pivot = Pivot{point, out.normalized()};
  }
  const std::vector<std::string> files = offline_files(options, scene);
  const std::optional<Scene> from = mapping(options);
  const Motions motions = read_all(options, files, from ? &*from : nullptr);
  const double duration = checked_duration(files[0], (motions.end - motions.begin) / options.speed);
  for (std::size_t i = 0; i < files.size(); ++i) {
    SessionOptions of_instrument = options.session;
    of_instrument.forces = file_of_instrument(options.session.forces, scene, i);
    prepare(of_instrument, files);
  }
  OutputRule(options.session.force).require_folder_without("--vtk", options.vtk, "");

  std::deque<ReplaySource> sources;
  std::vector<SlotSource*> played;
  std::int64_t slots = 0;
  nlohmann::ordered_json json;
  json["command"] = "replay";
  if (files.size() > 1) json["duration_s"] = rounded(duration, 6);
  Table table;
  for (std::size_t i = 0; i < files.size(); ++i) {
    const Trajectory& m = motions.of[i];
    played.push_back(&sources.emplace_back(m, options.speed, motions.begin));
    slots = std::max(slots, sources.back().slots());
    nlohmann::ordered_json of;
    describe(files[i], m, options.speed, (m.end() - m.begin()) / options.speed, of, table);
    if (files.size() == 1)
      json.update(of);
    else
      json["devices"].push_back(std::move(of));
  }
  std::optional<LateSteps> late;
  if (options.late > 0) {
    late.emplace(options.late, options.late_seed);
    json["late_steps"] = {{"spread", options.late}, {"seed", options.late_seed}};
  }
  const bool done = run_offline_replay(
      scene, played, slots, {options.session.forces, options.record, options.vtk, options.allow_refused},
      late, json, table);
  if (!options.session.json.empty()) write_json(options.session.json, json);
  print(table);
  return done ? 0 : 1;
}

// Several recordings with one time axis, each as a device (joint_session.h).
int replay_together(ReplayOptions& options) {
  const std::vector<std::string>& files = options.files;
  if (files.size() > max_instruments)
    throw UsageError("at most " + std::to_string(max_instruments) + " recordings are played at once");
  const std::optional<Scene> scene = mapping(options);
  const Motions motions = read_all(options, files, scene ? &*scene : nullptr);
  std::vector<HeardInstrument> instruments;
  for (std::size_t i = 0; scene && i < files.size(); ++i)
    instruments.push_back({scene->instruments[i].name, scene->instruments[i].device.id});
  const double duration = checked_duration(files[0], (motions.end - motions.begin) / options.speed);
  options.session.client.enable = !options.no_enable;
  options.session.client.arm_again = true;
  prepare(options.session, files);

  std::deque<ReplaySource> sources;
  std::vector<SlotSource*> played;
  std::vector<std::int64_t> slots;
  for (const Trajectory& m : motions.of) {
    played.push_back(&sources.emplace_back(m, options.speed, motions.begin));
    slots.push_back(sources.back().slots());
  }
  JointSession session(options.session, files.size(), instruments);
  session.check_outputs(files);
  session.run(played, slots, "replay");
  nlohmann::ordered_json json;
  json["command"] = "replay";
  json["duration_s"] = rounded(duration, 6);
  Table table;
  return session.finish(json, table, [&](std::size_t i, nlohmann::ordered_json& of, Table& rows) {
    const Trajectory& m = motions.of[i];
    describe(files[i], m, options.speed, (m.end() - m.begin()) / options.speed, of, rows);
  });
}

int replay(ReplayOptions& options) {
  if (!options.schedule.empty()) return reproduce(options);
  if (options.offline) return replay_without_daemon(options);
  if (options.files.empty()) throw UsageError("FILE is required, or --offline with a scene or a schedule");
  if (options.files.size() > 1) return replay_together(options);
  const std::string& file = options.files.front();
  const std::optional<Scene> scene = mapping(options);
  if (scene) options.session.client.device_id = scene->first().device.id;
  const Trajectory trajectory = read(options, file, scene ? &scene->first().device : nullptr);
  const double duration = checked_duration(file, (trajectory.end() - trajectory.begin()) / options.speed);
  options.session.client.enable = !options.no_enable;
  options.session.client.arm_again = true;
  prepare(options.session, options.files);

  ReplaySource source(trajectory, options.speed);
  nlohmann::ordered_json json;
  json["command"] = "replay";
  Table table;
  describe(file, trajectory, options.speed, duration, json, table);
  Session session(options.session, source.slots());
  run(session, options.session, source, "replay");
  report(session, options.session, json, table);
  return finish(session, options.session, json, table);
}

}  // namespace

Command add_replay(CLI::App& application) {
  auto options = std::make_shared<ReplayOptions>();
  CLI::App* app = application.add_subcommand(
      "replay",
      "Plays a recording as a device at 1 kHz, by the file's own time stamps, and times the answers.");
  app->add_option(
         "FILE", options->files,
         "CSV: t,px,py,pz,qx,qy,qz,qw[,buttons]; or a rosbag2 directory or .db3. Several, with one time "
         "axis, are the devices of the scene's instruments in their order, or those of --device-id. Offline "
         "without any: the scene's own")
      ->type_name("");
  app->add_option("--topic", options->topic, "of a rosbag2: which of its topics with poses");
  add_units_option(*app, options->units, "length unit of the file");
  CLI::Option* centre = app->add_flag("--centre,--center", options->centre,
                                      "put the recording's mean position at the device's origin");
  app->add_option("--scale", options->scale, "scale the positions, after centring")
      ->check(positive)
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
  CLI::Option* const late =
      app->add_option("--late", options->late,
                      "offline: each step takes 8 ms · exp(SPREAD n), n a normal random number, as on a "
                      "machine that has more to do")
          ->check(CLI::Range(0.0, 3.0))
          ->type_name("SPREAD")
          ->needs(offline)
          ->excludes(app->get_option("--schedule"));
  app->add_option("--late-seed", options->late_seed, "of those numbers")->needs(late);
  app->add_option("--pivot", options->pivot,
                  "offline: turn the (first) instrument about its tip so that its shaft passes through this "
                  "point of the scene [m]; live, the scene's mapping.pivot does")
      ->delimiter(',')
      ->expected(3)
      ->type_name("X,Y,Z")
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
      "Example: haptic replay recording.csv --centre --json figures.json\n"
      "Example: haptic replay sculpt.csv hold.csv --forces forces.csv   (and forces.NAME.csv of the second)\n"
      "Example: haptic replay recording --offline --scene scene.yaml --forces forces.csv\n"
      "Example: haptic replay --offline --scene two_hands.yaml --forces forces.csv   (its own motions)");
  return {app, [options] { return replay(*options); }};
}

}  // namespace hapticd
