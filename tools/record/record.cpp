// haptic record: listens to a running daemon and keeps what it hears, for ROS 2 and for ParaView.
#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <thread>

#include "haptic/clock.h"
#include "server/dds/network.h"
#include "server/files/output_file.h"
#include "server/files/usage.h"
#include "server/observe/bag_recorder.h"
#include "server/record/bag_writer.h"
#include "tools/cli/command.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/cli/report.h"
#include "tools/record/instrument_list.h"
#include "tools/record/scene_frames.h"
#include "tools/record/tick_listener.h"

namespace hapticd {
namespace {

struct RecordOptions {
  std::string directory, vtk, json, secure, role = "viewer";
  bool force = false;
  std::uint32_t domain = 0;
  std::vector<std::uint32_t> devices;  // none: those of the scene's instruments
  double duration = 0, wait = 10;
};

// A device that is listened to, and where it goes.
struct Recorded {
  const HeardInstrument device;
  std::optional<BagRecorder> bag;
  TickListener listener;
  std::uint64_t ticks = 0;

  Recorded(const Participant& participant, const HeardInstrument& of, const std::string& directory)
      : device(of), listener(participant, of.device_id) {
    if (!directory.empty()) bag.emplace(directory, of.device_id);
  }
  void take() {
    listener.take([this](const ForceRecord& record) {
      ++ticks;
      if (bag) bag->push(record);
    });
    listener.take_statuses([this](const Diagnostic& d) {
      if (bag) bag->push(d);
    });
  }
  std::uint64_t kept() const { return bag ? bag->kept() : 0; }
  std::uint64_t lost() const { return (bag ? bag->lost() : 0) + listener.dropped(); }
};

std::string waited(const RecordOptions& o) {
  return " in " + dds_place(o.domain, "loopback") + " within " + std::to_string(static_cast<int>(o.wait)) +
         " s";
}

std::vector<HeardInstrument> devices_of(const RecordOptions& o, const Participant& participant) {
  std::vector<HeardInstrument> devices;
  for (const std::uint32_t id : o.devices) devices.push_back({std::to_string(id), id});
  if (!devices.empty()) return devices;
  InstrumentList list(participant);
  if (!list.await(o.wait) && !interrupted()) throw std::runtime_error("no daemon answered" + waited(o));
  devices = list.all();
  if (devices.empty()) devices.push_back({"0", 0});
  return devices;
}

// One recording a device: DIR of the first, DIR.NAME of the others.
std::deque<Recorded> listeners(const RecordOptions& o, const Participant& participant) {
  const std::vector<HeardInstrument> devices = devices_of(o, participant);
  std::vector<std::string> names;
  for (const HeardInstrument& d : devices) names.push_back(d.name);
  std::vector<std::filesystem::path> directories(devices.size());
  if (!o.directory.empty()) directories = one_file_each(o.directory, names);
  for (const std::filesystem::path& directory : directories)
    if (!directory.empty()) require_no_bag(directory);
  std::deque<Recorded> all;
  for (std::size_t i = 0; i < devices.size(); ++i)
    all.emplace_back(participant, devices[i], directories[i].string());
  return all;
}

void figures_of(const Recorded& r, nlohmann::ordered_json& json) {
  json["ticks"] = r.ticks;
  json["ticks_without_pose"] = r.listener.without_pose();
  json["messages_recorded"] = r.kept();
  json["messages_lost"] = r.lost();
}

// Returns the exit code. Of several devices the figures are `devices`, and their sums stand beside it.
int finish(const RecordOptions& o, const std::deque<Recorded>& devices, int frames) {
  nlohmann::ordered_json json, list = nlohmann::ordered_json::array();
  json["command"] = "record";
  Table table;
  bool good = true;
  for (const Recorded& r : devices) {
    nlohmann::ordered_json of;
    if (devices.size() > 1) {
      of["instrument"] = r.device.name;
      of["device_id"] = r.device.device_id;
      table.emplace_back("device " + std::to_string(r.device.device_id), r.device.name);
    }
    figures_of(r, of);
    table.emplace_back("ticks heard", std::to_string(r.ticks));
    table.emplace_back("messages recorded / lost",
                       std::to_string(r.kept()) + " / " + std::to_string(r.lost()));
    good = good && r.ticks > 0 && r.lost() == 0 && !(r.bag && r.bag->failed());
    for (const char* key : {"ticks", "ticks_without_pose", "messages_recorded", "messages_lost"})
      json[key] = json.value(key, std::uint64_t{0}) + of[key].get<std::uint64_t>();
    list.push_back(std::move(of));
  }
  json["frames"] = frames;
  if (devices.size() > 1) json["devices"] = std::move(list);
  if (!o.json.empty()) write_json(o.json, json);
  table.emplace_back("frames", std::to_string(frames));
  print(table);
  return good ? 0 : 1;
}

int record(const RecordOptions& o) {
  if (o.directory.empty() && o.vtk.empty())
    throw UsageError("record: where to? DIR for a recording, or --vtk DIR");
  const OutputRule rule(o.force);
  rule.require_folder_without("--vtk", o.vtk, "");
  rule.require_figures("--json", o.json);
  rule.require_folder("DIR", o.directory);
  if (!o.directory.empty()) require_no_bag(o.directory);
  std::optional<Security> security;
  if (!o.secure.empty()) security = security_files(o.secure, o.role);
  const Domain domain(o.domain, viewer_dds_profile());
  const Participant participant(domain, security);
  std::deque<Recorded> devices = listeners(o, participant);
  std::optional<SceneFrames> frames;
  if (!o.vtk.empty()) frames.emplace(participant, o.vtk);

  Progress progress("record");
  const std::int64_t begun = monotonic_ns();
  while (!interrupted()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    const double t = 1e-9 * static_cast<double>(monotonic_ns() - begun);
    std::uint64_t ticks = 0;
    for (Recorded& r : devices) {
      r.take();
      ticks += r.ticks;
      if (r.ticks == 0 && t > o.wait)
        throw std::runtime_error("no daemon answered for device " + std::to_string(r.device.device_id) +
                                 waited(o));
    }
    if (frames) frames->poll();
    if (o.duration > 0 && t >= o.duration) break;
    progress.show(o.duration > 0 ? t / o.duration : 0, std::to_string(ticks) + " ticks");
  }
  if (frames) frames->finish();
  for (Recorded& r : devices)
    if (r.bag) r.bag->stop();
  return finish(o, devices, frames ? frames->count() : 0);
}

}  // namespace

Command add_record(CLI::App& application) {
  auto o = std::make_shared<RecordOptions>();
  CLI::App* app = application.add_subcommand(
      "record",
      "Records a running daemon: poses, wrenches and diagnostics as rosbag2, the scene for ParaView.");
  app->add_option("DIR", o->directory,
                  "rosbag2 recording to make (sqlite3); of several instruments that of the first, DIR.NAME "
                  "of the others")
      ->type_name("");
  app->add_option("--vtk", o->vtk, "write the scene 25 times a second for ParaView, DIR/scene.pvd")
      ->type_name("DIR");
  app->add_option("--duration", o->duration, "stop after so many seconds; 0: at Ctrl-C")
      ->check(not_negative)
      ->capture_default_str();
  app->add_option("--wait", o->wait, "how long to wait for a daemon [s]")->capture_default_str();
  app->add_option("--domain", o->domain, "DDS domain of the daemon")
      ->check(CLI::Range(0u, 230u))
      ->capture_default_str();
  app->add_option("--device-id", o->devices,
                  "whose ticks: ID, or ID,ID; default: the devices of all the scene's instruments")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("ID");
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
