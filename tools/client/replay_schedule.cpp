#include "tools/client/replay_schedule.h"

#include <algorithm>
#include <cstdio>

#include "server/files/output_file.h"
#include "server/scene/scene_reader.h"
#include "server/schedule/schedule_replay.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"
#include "tools/client/force_row.h"
#include "tools/client/replay_offline.h"

namespace hapticd {
namespace {

ForceRow row_of(const ReproducedTick& tick, int device, std::int64_t slot) {
  const ForceSample& f = tick.force[device];
  const DeviceSample& sent = tick.live.device[device].input.sample;
  ForceRow row;
  row.slot = slot;
  row.sent = {sent.pose, sent.buttons};
  row.force = f.force;
  row.torque = f.torque;
  row.status = f.status;
  row.state_age_us = 1e-3 * static_cast<double>(f.state_age_ns);
  row.problem_age_ms = 1e-6 * static_cast<double>(f.problem_age_ns);
  row.contacts = f.contacts;
  row.active = f.active;
  row.penetration_um = 1e6 * f.penetration;
  return row;
}

struct Device {
  std::string csv = force_row_header;
  double peak = 0, off = 0;  // [N]
};

std::string newtons(double f) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g N", f);
  return text;
}

}  // namespace

bool run_schedule_replay(const std::string& file, const std::string& scene_file, const std::string& forces,
                         nlohmann::ordered_json& json, Table& table) {
  const Schedule schedule = read_schedule(file);
  const Scene scene =
      as_run(schedule, read_scene(scene_file.empty() ? scene_of(schedule).string() : scene_file));
  const std::size_t devices = scene.instruments.size();
  std::vector<Device> of(devices);
  Progress progress("schedule");
  bool stopped = false;
  std::size_t done = 0;
  const Reproduction r = replay_schedule(scene, schedule, [&](const ReproducedTick& tick) {
    for (std::size_t d = 0; d < devices; ++d) {
      const int i = static_cast<int>(d);
      if (!forces.empty()) append(of[d].csv, row_of(tick, i, static_cast<std::int64_t>(done)));
      of[d].peak = std::max(of[d].peak, tick.force[i].force.norm());
      of[d].off = std::max(of[d].off, (tick.force[i].force - tick.live.device[i].force).norm());
    }
    if (++done % 100 == 0) {
      progress.show(static_cast<double>(done) / static_cast<double>(schedule.ticks.size()), "");
      stopped = interrupted();
    }
    return !stopped;
  });
  for (std::size_t d = 0; !forces.empty() && d < devices; ++d)
    write_file(file_of_instrument(forces, scene, d), of[d].csv);
  const std::uint64_t lost = schedule.ticks_lost + schedule.steps_lost + r.without_problem + r.gaps;
  const bool same = r.ticks > 0 && r.largest_off <= same_force && r.other_status == 0;
  json["scene"] = scene.name;
  json["ticks"] = r.ticks;
  json["publications"] = r.publications;
  json["reference_factors"] = r.references;
  json["elements_removed"] = r.removed;
  if (devices == 1) json["force_peak_n"] = of[0].peak;
  json["force_off_max_n"] = r.largest_off;
  json["torque_off_max_nm"] = r.largest_torque_off;
  json["worst_tick"] = r.worst_tick;
  json["other_status"] = r.other_status;
  json["clock_asked_otherwise"] = r.unsure;
  json["records_lost"] = lost;
  json["ended_well"] = schedule.complete;
  json["same"] = same;
  for (std::size_t d = 0; devices > 1 && d < devices; ++d)
    json["devices"].push_back({{"instrument", scene.instruments[d].name},
                               {"device_id", scene.instruments[d].device.id},
                               {"force_peak_n", of[d].peak},
                               {"force_off_max_n", of[d].off}});
  table.emplace_back("schedule", file + ", " + scene.name + ", " + std::to_string(r.ticks) + " ticks, " +
                                     std::to_string(r.publications) + " problems");
  for (std::size_t d = 0; d < devices; ++d)
    table.emplace_back((devices > 1 ? scene.instruments[d].name + ": " : "") + "force, peak",
                       fixed(of[d].peak, 4) + " N");
  table.emplace_back("elements removed", std::to_string(r.removed));
  table.emplace_back("off the live run's, at most",
                     newtons(r.largest_off) + ", at tick " + std::to_string(r.worst_tick));
  if (r.other_status > 0) table.emplace_back("ticks with another status", std::to_string(r.other_status));
  if (lost > 0) table.emplace_back("records lost", std::to_string(lost));
  if (!schedule.complete) table.emplace_back("the run", "did not end well; the record is good up to there");
  return !stopped && same && lost == 0;
}

}  // namespace hapticd
