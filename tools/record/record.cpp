// haptic record: listens to a running daemon and keeps what it hears, for ROS 2 and for ParaView.
#include <chrono>
#include <cstdio>
#include <memory>
#include <optional>
#include <thread>

#include "server/observe/bag_recorder.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"
#include "tools/record/scene_frames.h"
#include "tools/record/tick_listener.h"

namespace hapticd {
namespace {

struct RecordOptions {
  std::string directory, vtk, json, secure, role = "viewer";
  bool force = false;
  std::uint32_t domain = 0, device_id = 0;
  double duration = 0, wait = 10;
};

int record(const RecordOptions& o) {
  if (o.directory.empty() && o.vtk.empty())
    throw UsageError("record: where to? DIR for a recording, or --vtk DIR");
  const OutputRule rule(o.force);
  rule.require_folder_without("--vtk", o.vtk, "");
  rule.require_figures("--json", o.json);
  std::optional<Security> security;
  if (!o.secure.empty()) security = security_files(o.secure, o.role);
  const Domain domain(o.domain, read_dds_profile("loopback"));
  const Participant participant(domain, security);
  std::optional<BagRecorder> bag;
  if (!o.directory.empty()) bag.emplace(o.directory, o.device_id);
  std::optional<SceneFrames> frames;
  if (!o.vtk.empty()) frames.emplace(participant, o.vtk);
  TickListener listener(participant, o.device_id);

  Progress progress("record");
  const std::int64_t begun = monotonic_ns();
  std::uint64_t ticks = 0;
  while (!interrupted()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    listener.take([&](const ForceRecord& record) {
      ++ticks;
      if (bag) bag->push(record);
    });
    listener.take_statuses([&](const Diagnostic& d) {
      if (bag) bag->push(d);
    });
    if (frames) frames->poll();
    const double t = 1e-9 * static_cast<double>(monotonic_ns() - begun);
    if (ticks == 0 && t > o.wait)
      throw std::runtime_error("no daemon answered for device " + std::to_string(o.device_id) + " in " +
                               dds_place(o.domain, "loopback") + " within " +
                               std::to_string(static_cast<int>(o.wait)) + " s");
    if (o.duration > 0 && t >= o.duration) break;
    progress.show(o.duration > 0 ? t / o.duration : 0, std::to_string(ticks) + " ticks");
  }
  if (frames) frames->finish();
  if (bag) bag->stop();

  nlohmann::ordered_json json;
  json["command"] = "record";
  json["ticks"] = ticks;
  json["ticks_without_pose"] = listener.without_pose();
  json["messages_recorded"] = bag ? bag->kept() : 0;
  json["messages_lost"] = (bag ? bag->lost() : 0) + listener.dropped();
  json["frames"] = frames ? frames->count() : 0;
  if (!o.json.empty()) write_json(o.json, json);
  print(
      {{"ticks heard", std::to_string(ticks)},
       {"messages recorded / lost", json["messages_recorded"].dump() + " / " + json["messages_lost"].dump()},
       {"frames", json["frames"].dump()}});
  return ticks > 0 && json["messages_lost"] == 0 && !(bag && bag->failed()) ? 0 : 1;
}

}  // namespace

Command add_record(CLI::App& application) {
  auto o = std::make_shared<RecordOptions>();
  CLI::App* app = application.add_subcommand(
      "record",
      "Records a running daemon: poses, wrenches and diagnostics as rosbag2, the scene for ParaView.");
  app->add_option("DIR", o->directory, "rosbag2 recording to make (sqlite3)")->type_name("");
  app->add_option("--vtk", o->vtk, "write the scene 25 times a second for ParaView, DIR/scene.pvd")
      ->type_name("DIR");
  app->add_option("--duration", o->duration, "stop after so many seconds; 0: at Ctrl-C")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app->add_option("--wait", o->wait, "how long to wait for a daemon [s]")->capture_default_str();
  app->add_option("--domain", o->domain, "DDS domain of the daemon")
      ->check(CLI::Range(0u, 230u))
      ->capture_default_str();
  app->add_option("--device-id", o->device_id, "whose ticks")->capture_default_str();
  app->add_option("--secure", o->secure, "keys for a daemon that runs with --secure")->type_name("DIR");
  app->add_option("--role", o->role, "whose keys of those")
      ->check(CLI::IsMember({"device", "viewer", "operator"}))
      ->capture_default_str();
  app->add_option("--json", o->json, "write the figures to this file")->type_name("FILE");
  add_force_option(*app, o->force);
  app->footer(
      "`hapticd --record DIR` loses no tick that DDS loses, and needs no second process.\n"
      "Example: haptic record stroke --vtk stroke_vtk --duration 20");
  return {app, [o] { return record(*o); }};
}

}  // namespace hapticd
