// haptic replay --offline: the run, and what it leaves.
#include "tools/client/replay_offline.h"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>

#include "server/record/device_bag.h"
#include "tools/client/force_row.h"
#include "tools/client/offline_replay.h"
#include "tools/record/vtk_series.h"

namespace hapticd {
namespace {

ForceRow row_of(const ReplayedTick& tick) {
  const ForceSample& f = tick.record.force;
  ForceRow row;
  row.slot = tick.slot;
  row.sent = tick.command;
  row.force = f.force;
  row.torque = f.torque;
  row.status = f.status;
  row.state_age_us = 1e-3 * static_cast<double>(f.state_age_ns);
  row.problem_age_ms = 1e-6 * static_cast<double>(f.problem_age_ns);
  row.contacts = f.contacts;
  row.active = f.active;
  row.penetration_um = 1e6 * f.penetration;
  row.removed = tick.removed;
  return row;
}

// States that the watchdog refused. Numbers rise, poses are finite and unit offline, so each was too fast.
class Refusals {
 public:
  explicit Refusals(double max_speed) : max_speed_(max_speed) {}

  void note(const ReplayedTick& tick) {
    const Vec3 p = tick.command.pose.p;
    if (tick.record.force.status & status_rejected) {
      if (count_++ == 0) first_slot_ = tick.slot;
      fastest_ = std::max(fastest_, 1e3 * (p - before_).norm());
    }
    before_ = p;
  }
  std::int64_t count() const { return count_; }
  std::string text() const {
    return std::to_string(count_) + " states were refused, the first at " +
           fixed(1e-3 * static_cast<double>(first_slot_), 3) + " s: up to " + fixed(fastest_, 2) +
           " m/s, where the device's max_speed is " + fixed(max_speed_, 2) + " m/s";
  }

 private:
  const double max_speed_;
  Vec3 before_ = Vec3::Zero();
  std::int64_t count_ = 0, first_slot_ = 0;
  double fastest_ = 0;
};

// Every second step of a 50 Hz scene, as it is published (diagnostics.h).
constexpr double frames_per_second = 25;

class Frames {
 public:
  Frames(const Scene& scene, const std::filesystem::path& directory)
      : scene_(scene),
        series_(directory),
        every_(std::max(1, static_cast<int>(scene.rate / frames_per_second))) {}

  void add(const ReplayedStep& step) {
    if (step.slot < 0 || steps_++ % every_ != 0) return;
    std::vector<VtkBody> bodies;
    for (std::size_t b = 0; b < scene_.bodies.size(); ++b) {
      const Body& body = step.world.bodies()[b];
      VtkBody out{scene_.bodies[b].name, &scene_.bodies[b].mesh, {}, {}};
      if (body.deformable) {
        out.nodes = body.state.x;
        out.alive = body.state.alive;
      }
      bodies.push_back(out);
    }
    const DeviceSettings& d = scene_.device;
    series_.add(1e-3 * static_cast<double>(step.slot), bodies,
                {step.instrument.p, d.frame * step.force.force / d.force_scale, step.contacts});
  }
  int finish() const {
    series_.finish();
    return series_.frames();
  }

 private:
  const Scene& scene_;
  VtkSeries series_;
  const int every_;
  int steps_ = 0;
};

}  // namespace

bool run_offline_replay(const Scene& scene, SlotSource& source, std::int64_t slots,
                        const OfflineOutputs& outputs, nlohmann::ordered_json& json, Table& table) {
  std::string csv = force_row_header;
  std::optional<DeviceBag> bag;
  std::optional<Frames> frames;
  // Stamps count from 1970: there is no clock whose time they could be.
  if (!outputs.record.empty()) bag.emplace(outputs.record, scene.device.id, 0);
  if (!outputs.vtk.empty()) frames.emplace(scene, outputs.vtk);

  double peak = 0, penetration = 0;
  std::int64_t in_contact = 0, not_finite = 0, capped = 0;
  Refusals refused(scene.device.max_speed);
  std::uint32_t removed = 0, status = 0;
  ReplaySinks sinks;
  sinks.tick = [&](const ReplayedTick& tick) {
    if (tick.slot < 0) return;
    append(csv, row_of(tick));
    if (bag) bag->note(tick.record);
    if (bag && tick.slot % 1000 == 999) bag->commit();
    const ForceSample& f = tick.record.force;
    refused.note(tick);
    peak = std::max(peak, f.force.norm());
    penetration = std::max(penetration, f.penetration);
    in_contact += f.active > 0;
    not_finite += (f.status & status_not_finite) != 0;
    capped += (f.status & status_solver_cap) != 0;
    status |= f.status;
    removed = tick.removed;
  };
  if (frames) sinks.step = [&](const ReplayedStep& step) { frames->add(step); };
  const bool complete = replay_offline(scene, source, slots, sinks);

  if (bag) bag->close();
  if (bag && bag->bag().failed())
    throw std::runtime_error("the recording lost " + std::to_string(bag->bag().lost()) +
                             " messages: " + bag->bag().failure());
  if (!outputs.forces.empty()) write_file(outputs.forces, csv);
  json["scene"] = scene.name;
  json["complete"] = complete;
  json["slots"] = slots;
  json["force_peak_n"] = peak;
  json["penetration_max_um"] = 1e6 * penetration;
  json["contact_share"] = rounded(static_cast<double>(in_contact) / static_cast<double>(slots), 5);
  json["elements_removed"] = removed;
  json["not_finite"] = not_finite;
  json["states_refused"] = refused.count();
  json["solver_caps"] = capped;
  json["status_seen"] = status;
  json["status_seen_text"] = status_text(status);
  table.emplace_back("scene", scene.name + ", offline");
  table.emplace_back("force, peak", fixed(peak, 4) + " N");
  table.emplace_back("elements removed", std::to_string(removed));
  table.emplace_back("status bits seen", status_text(status));
  if (bag) {
    json["messages_recorded"] = bag->bag().kept();
    table.emplace_back("recorded", std::to_string(bag->bag().kept()) + " messages in " + outputs.record);
  }
  if (frames) {
    json["frames"] = frames->finish();
    table.emplace_back("frames", json["frames"].dump() + " in " + outputs.vtk + "/scene.pvd");
  }
  if (refused.count() > 0) {
    table.emplace_back("states refused", refused.text());
    if (!outputs.allow_refused)
      std::fprintf(stderr, "haptic: %s: these are not the recorded forces (--allow-refused: exit code 0)\n",
                   refused.text().c_str());
  }
  return complete && not_finite == 0 && (refused.count() == 0 || outputs.allow_refused);
}

}  // namespace hapticd
