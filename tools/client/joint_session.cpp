#include "tools/client/joint_session.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <mutex>
#include <thread>

#include "server/files/output_file.h"
#include "tools/cli/command.h"
#include "tools/cli/progress.h"

namespace hapticd {
namespace {

std::vector<HeardInstrument> first_of(std::vector<HeardInstrument> all, std::size_t count,
                                      const std::string& whose) {
  if (all.size() < count)
    throw UsageError(whose + " has " + std::to_string(all.size()) + " instrument" +
                     (all.size() == 1 ? "" : "s") + ": name the devices with --device-id ID,ID");
  all.resize(count);
  return all;
}

std::vector<HeardInstrument> devices_of(const SessionOptions& options, const Participant& participant,
                                        std::size_t count, std::vector<HeardInstrument> instruments) {
  if (!options.devices.empty()) {
    std::vector<HeardInstrument> named;
    for (const std::uint32_t id : options.devices) named.push_back({std::to_string(id), id});
    return named;
  }
  if (!instruments.empty()) return first_of(std::move(instruments), count, "the scene");
  InstrumentList list(participant);
  if (!list.await(options.client.match_timeout))
    throw std::runtime_error(
        "no daemon told its instruments in " + dds_place(options.client.domain, default_dds_profile_name()) +
        " within " + std::to_string(static_cast<int>(options.client.match_timeout)) +
        " s: start one with `hapticd SCENE.yaml --domain " + std::to_string(options.client.domain) +
        "`, or name the devices with --device-id");
  return first_of(list.all(), count, "the daemon's scene");
}

}  // namespace

JointSession::JointSession(const SessionOptions& options, std::size_t count,
                           std::vector<HeardInstrument> instruments)
    : options_(options),
      domain_(options.client.domain, default_dds_profile()),
      participant_(domain_, options.client.security),
      devices_(devices_of(options, participant_, count, std::move(instruments))),
      start_(static_cast<int>(count)) {}

std::vector<std::string> JointSession::names() const {
  std::vector<std::string> all;
  for (const HeardInstrument& d : devices_) all.push_back(d.name);
  return all;
}

void JointSession::check_outputs(const std::vector<std::string>& inputs) const {
  if (options_.forces.empty()) return;
  for (const std::filesystem::path& file : one_file_each(options_.forces, names()))
    require_forces(options_, file.string(), inputs);
}

void JointSession::leave() noexcept {
  for (Device& d : played_) d.client.leave();
}

// One that fails takes the others with it, as they would wait for it.
void JointSession::play(std::size_t i, SlotSource& source, const std::function<void(std::int64_t)>& poll) {
  try {
    played_[i].client.run(source, poll);
  } catch (...) {
    leave();
    throw;
  }
}

void JointSession::run(const std::vector<SlotSource*>& sources, const std::vector<std::int64_t>& slots,
                       const std::string& what) {
  for (std::size_t i = 0; i < count(); ++i) {
    ClientSettings settings = options_.client;
    settings.device_id = devices_[i].device_id;
    settings.start = &start_;
    played_.emplace_back(participant_, settings, slots[i]);
  }
  played_[0].monitor.keep_at(options_.snapshots_at);
  std::mutex failing;
  std::exception_ptr failure;  // the first
  const auto guarded = [&](std::size_t i, const std::function<void(std::int64_t)>& poll) {
    try {
      play(i, *sources[i], poll);
    } catch (...) {
      const std::lock_guard lock(failing);
      if (!failure) failure = std::current_exception();
    }
  };
  Progress progress(what);
  const auto all = static_cast<double>(slots[0]);
  const auto first = [&](std::int64_t reached) {
    played_[0].monitor.poll_at(1e-3 * static_cast<double>(reached));
    std::string forces;
    for (const Device& d : played_) forces += fixed(d.client.newest_force(), 3) + " N, ";
    if (reached < 0)
      progress.show(0, "arming");
    else
      progress.show(static_cast<double>(reached + 1) / all,
                    forces + std::to_string(played_[0].monitor.newest().elements_removed) + " removed");
  };
  machine_ = while_watching(options_, [&] {
    std::vector<std::thread> others;
    for (std::size_t i = 1; i < count(); ++i)
      others.emplace_back([&, i] { guarded(i, [&, i](std::int64_t) { played_[i].monitor.poll(); }); });
    guarded(0, first);
    for (std::thread& t : others) t.join();
  });
  if (failure) std::rethrow_exception(failure);
  for (const Device& d : played_)
    if (const Grant& grant = d.client.grant(); !grant.granted)
      std::fprintf(stderr, "haptic: %s refused: %s\n", grant.what.c_str(), grant.detail.c_str());
  for (int i = 0; i < 15; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    for (Device& d : played_) d.monitor.poll();
  }
}

int JointSession::finish(nlohmann::ordered_json& json, Table& table,
                         const std::function<void(std::size_t, nlohmann::ordered_json&, Table&)>& each) {
  std::int64_t first = played_[0].client.book().plan().t0_ns, last = first;
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  std::vector<std::string> faults;
  for (std::size_t i = 0; i < count(); ++i) {
    const Played played(played_[i].monitor, played_[i].client, machine_);
    const std::int64_t begun = played.client.book().plan().t0_ns;
    first = std::min(first, begun);
    last = std::max(last, begun);
    nlohmann::ordered_json of;
    of["instrument"] = devices_[i].name;
    Table rows{{"device " + std::to_string(devices_[i].device_id), devices_[i].name}};
    each(i, of, rows);
    report(played, options_, of, rows);
    if (const std::string fault = fault_of(played, options_); !fault.empty())
      faults.push_back("device " + std::to_string(devices_[i].device_id) + ": " + fault);
    list.push_back(std::move(of));
    table.insert(table.end(), rows.begin(), rows.end());
  }
  json["start_skew_us"] = rounded(1e-3 * static_cast<double>(last - first), 1);
  json["devices"] = std::move(list);
  if (!options_.json.empty()) write_json(options_.json, json);
  if (!options_.forces.empty()) {
    const std::vector<std::filesystem::path> files = one_file_each(options_.forces, names());
    for (std::size_t i = 0; i < count(); ++i)
      write_file(files[i].string(), forces_csv({played_[i].monitor, played_[i].client, machine_}));
  }
  if (!options_.snapshots.empty()) played_[0].monitor.write_surfaces(options_.snapshots);
  print(table);
  for (const std::string& fault : faults) std::fprintf(stderr, "haptic: %s\n", fault.c_str());
  return faults.empty() ? 0 : 1;
}

}  // namespace hapticd
