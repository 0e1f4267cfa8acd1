// haptic replay --offline: the run, and what it leaves.
#include "tools/client/replay_offline.h"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>

#include "server/files/output_file.h"
#include "server/observe/instrument_shape.h"
#include "server/observe/operation.h"
#include "server/record/device_bag.h"
#include "tools/client/dropped_contacts.h"
#include "tools/client/force_row.h"
#include "tools/client/offline_replay.h"
#include "tools/record/instrument_surface.h"
#include "tools/record/vtk_series.h"

namespace hapticd {
namespace {

ForceRow row_of(const ReplayedTick& tick, int device) {
  const ForceSample& f = tick.record[device].force;
  ForceRow row;
  row.slot = tick.slot;
  row.sent = tick.command[device];
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

  void note(std::int64_t slot, const Vec3& p, std::uint32_t status) {
    if (status & status_rejected) {
      if (count_++ == 0) first_slot_ = slot;
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
  Frames(const Scene& scene, std::size_t devices, const std::filesystem::path& directory)
      : scene_(scene),
        devices_(static_cast<int>(devices)),
        series_(directory),
        every_(std::max(1, static_cast<int>(scene.rate / frames_per_second))) {
    for (const SceneInstrument& i : scene.instruments)
      surfaces_.push_back(instrument_surface(instrument_shape(i.shape)));
  }

  void add(const ReplayedStep& step) {
    if (step.slot < 0 || steps_++ % every_ != 0) return;
    std::vector<VtkBody> bodies;
    for (std::size_t b = 0; b < scene_.bodies.size(); ++b) {
      const Body& body = step.world.bodies()[b];
      VtkBody out{scene_.bodies[b].name,
                  &body.model.mesh,
                  {},
                  {},
                  shear_modulus(scene_.bodies[b])};  // which cuts change
      if (body.deformable) {
        out.nodes = body.state.x;
        out.alive = tets_there(body.model, body.state);
      }
      bodies.push_back(out);
    }
    VtkContact contact;
    contact.contacts = step.contacts;
    for (int i = 0; i < devices_; ++i) {
      const DeviceSettings& d = scene_.instruments[static_cast<std::size_t>(i)].device;
      const ForceRecord& record = step.newest.record[i];
      contact.instruments.push_back({record.instrument.X, d.frame * record.force.force / d.force_scale,
                                     surfaces_[static_cast<std::size_t>(i)]});
    }
    series_.add(1e-3 * static_cast<double>(step.slot), bodies, contact);
  }
  int finish() const {
    series_.finish();
    return series_.frames();
  }

 private:
  static double shear_modulus(const SceneBody& body) {
    return body.kind == BodyKind::deformable ? body.material.young / (2 * (1 + body.material.poisson)) : 0;
  }

  const Scene& scene_;
  const int devices_;
  std::vector<std::vector<Vec3>> surfaces_;  // of the instruments
  VtkSeries series_;
  const int every_;
  int steps_ = 0;
};

// One device's ticks, and what they leave.
class DeviceTrace {
 public:
  DeviceTrace(const Scene& scene, int device, const OfflineOutputs& outputs)
      : of_(scene.instruments[static_cast<std::size_t>(device)]),
        device_(device),
        keeps_forces_(!outputs.forces.empty()),
        refused_(of_.device.max_speed) {
    if (outputs.record.empty()) return;
    const std::string folder = file_of_instrument(outputs.record, scene, static_cast<std::size_t>(device));
    bag_.emplace(folder, of_.device.id, 0);  // there is no clock whose time stamps could be
  }

  void note(const ReplayedTick& tick) {
    if (keeps_forces_) append(csv_, row_of(tick, device_));
    if (bag_) bag_->note(tick.record[device_]);
    if (bag_ && tick.slot % 1000 == 999) bag_->commit();
    const ForceSample& f = tick.record[device_].force;
    refused_.note(tick.slot, tick.command[device_].pose.p, f.status);
    peak_ = std::max(peak_, f.force.norm());
    penetration_ = std::max(penetration_, f.penetration);
    in_contact_ += f.active > 0;
    dropped_.note(f.contacts, f.dropped, (f.status & status_contacts_dropped) != 0);
    dropped_.note_samples(f.samples, f.samples_dropped);
    not_finite_ += (f.status & status_not_finite) != 0;
    capped_ += (f.status & status_solver_cap) != 0;
    status_ |= f.status;
  }

  void close() {
    if (!bag_) return;
    bag_->close();
    if (bag_->bag().failed())
      throw std::runtime_error("the recording lost " + std::to_string(bag_->bag().lost()) +
                               " messages: " + bag_->bag().failure());
  }

  void figures(std::int64_t slots, nlohmann::ordered_json& json) const {
    json["force_peak_n"] = peak_;
    json["penetration_max_um"] = 1e6 * penetration_;
    json["contact_share"] = rounded(static_cast<double>(in_contact_) / static_cast<double>(slots), 5);
  }
  void counts(nlohmann::ordered_json& json) const {
    json["not_finite"] = not_finite_;
    json["states_refused"] = refused_.count();
    json["solver_caps"] = capped_;
    json["contacts_dropped"] = dropped_.to_json();
    json["status_seen"] = status_;
    json["status_seen_text"] = status_text(status_);
  }

  const SceneInstrument& instrument() const { return of_; }
  const std::string& csv() const { return csv_; }
  double peak() const { return peak_; }
  std::uint32_t status() const { return status_; }
  std::int64_t not_finite() const { return not_finite_; }
  const Refusals& refused() const { return refused_; }
  const DroppedContacts& dropped() const { return dropped_; }
  std::size_t recorded() const { return bag_ ? bag_->bag().kept() : 0; }

 private:
  const SceneInstrument& of_;
  const int device_;
  const bool keeps_forces_;
  std::string csv_ = force_row_header;
  std::optional<DeviceBag> bag_;
  Refusals refused_;
  double peak_ = 0, penetration_ = 0;
  std::int64_t in_contact_ = 0, not_finite_ = 0, capped_ = 0;
  DroppedContacts dropped_;
  std::uint32_t status_ = 0;
};

std::string whose(const DeviceTrace& trace, bool several) {
  return several ? trace.instrument().name + ": " : "";
}

void tabulate_status(const DeviceTrace& trace, const std::string& whose, const OfflineOutputs& outputs,
                     Table& table) {
  trace.dropped().tabulate(table, whose);
  table.emplace_back(whose + "status bits seen", status_text(trace.status()));
  if (trace.refused().count() == 0) return;
  table.emplace_back(whose + "states refused", trace.refused().text());
  if (!outputs.allow_refused)
    std::fprintf(stderr, "haptic: %s%s: these are not the recorded forces (--allow-refused: exit code 0)\n",
                 whose.c_str(), trace.refused().text().c_str());
}

}  // namespace

std::string file_of_instrument(const std::string& file, const Scene& scene, std::size_t instrument) {
  if (file.empty()) return file;
  std::vector<std::string> names;
  for (const SceneInstrument& held : scene.instruments) names.push_back(held.name);
  return one_file_each(file, names)[instrument].string();
}

bool run_offline_replay(const Scene& scene, const std::vector<SlotSource*>& sources, std::int64_t slots,
                        const OfflineOutputs& outputs, const std::optional<LateSteps>& late,
                        nlohmann::ordered_json& json, Table& table) {
  std::vector<std::unique_ptr<DeviceTrace>> devices;
  for (std::size_t i = 0; i < sources.size(); ++i)
    devices.push_back(std::make_unique<DeviceTrace>(scene, static_cast<int>(i), outputs));
  std::optional<Frames> frames;
  if (!outputs.vtk.empty()) frames.emplace(scene, sources.size(), outputs.vtk);

  std::uint32_t removed = 0;
  std::optional<Operation> operation;
  ReplaySinks sinks;
  sinks.tick = [&](const ReplayedTick& tick) {
    if (tick.slot < 0) return;
    for (const auto& device : devices) device->note(tick);
    removed = tick.removed;
  };
  sinks.step = [&](const ReplayedStep& step) {
    if (!operation) operation.emplace(step.world);
    if (step.slot >= 0) operation->follow(step.world, step.report, step.samples, 1 / scene.rate);
    if (frames) frames->add(step);
  };
  const bool complete = replay_offline(scene, sources, slots, sinks, late);

  const bool several = devices.size() > 1;
  bool sound = true;
  std::size_t recorded = 0;
  for (std::size_t i = 0; i < devices.size(); ++i) {
    DeviceTrace& d = *devices[i];
    d.close();
    if (!outputs.forces.empty()) write_file(file_of_instrument(outputs.forces, scene, i), d.csv());
    sound = sound && d.not_finite() == 0 && (d.refused().count() == 0 || outputs.allow_refused);
    recorded += d.recorded();
  }
  json["scene"] = scene.name;
  json["complete"] = complete;
  json["slots"] = slots;
  if (!several) devices[0]->figures(slots, json);
  json["elements_removed"] = removed;
  if (operation) json["operation"] = to_json(operation->measures());
  if (!several) devices[0]->counts(json);
  for (std::size_t i = 0; several && i < devices.size(); ++i) {
    nlohmann::ordered_json& of = json["devices"][i];  // where its motion is
    of["instrument"] = devices[i]->instrument().name;
    of["device_id"] = devices[i]->instrument().device.id;
    devices[i]->figures(slots, of);
    devices[i]->counts(of);
  }
  table.emplace_back("scene", scene.name + ", offline");
  for (const auto& device : devices)
    table.emplace_back(whose(*device, several) + "force, peak", fixed(device->peak(), 4) + " N");
  table.emplace_back("elements removed", std::to_string(removed));
  for (const auto& device : devices) tabulate_status(*device, whose(*device, several), outputs, table);
  if (!outputs.record.empty()) {
    json["messages_recorded"] = recorded;
    table.emplace_back("recorded", std::to_string(recorded) + " messages in " + outputs.record);
  }
  if (frames) {
    json["frames"] = frames->finish();
    table.emplace_back("frames", json["frames"].dump() + " in " + outputs.vtk + "/scene.pvd");
  }
  return complete && sound;
}

}  // namespace hapticd
