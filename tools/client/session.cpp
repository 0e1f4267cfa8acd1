#include "tools/client/session.h"

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <map>
#include <set>
#include <thread>

#include "server/files/input_error.h"
#include "server/files/output_file.h"
#include "tools/cli/command.h"
#include "tools/cli/progress.h"
#include "tools/client/dropped_contacts.h"
#include "tools/client/force_row.h"

namespace hapticd {
namespace {

// A force below this is not contact: well under a device's resolution, well over rounding.
constexpr double contact_force = 1e-6;

Vec3 force_of(const hapticd_msg_ForceCommand& m) { return {m.force[0], m.force[1], m.force[2]}; }

template <typename F>
void for_each_answer(const DeviceClient& client, F&& f) {
  for (std::int64_t k = 0; k < client.book().scheduled(); ++k)
    if (client.book().answered_ns(k) != 0) f(k, client.answer(k));
}

double share(std::int64_t part, std::int64_t whole) {
  return whole > 0 ? static_cast<double>(part) / static_cast<double>(whole) : 0;
}

// Of the slots that no stall of the machine strikes.
double answered_between_stalls(const SlotBook& book, const Stalls& stalls) {
  const SlotCount between = between_stalls(book, stalls);
  return share(between.answered, between.scheduled);
}

}  // namespace

void add_session_options(CLI::App& command, SessionOptions& options) {
  command.add_option("--domain", options.client.domain, "DDS domain of the daemon")
      ->check(CLI::Range(0u, 230u))
      ->capture_default_str();
  command
      .add_option("--secure", options.secure,
                  "keys for a daemon that runs with --secure: DIR from config/dds/security/make_keys.sh")
      ->type_name("DIR");
  command.add_option("--role", options.role, "whose keys of those")
      ->check(CLI::IsMember({"device", "viewer", "operator"}))
      ->capture_default_str();
  command.add_option("--device-id", options.devices, "the device to be, or devices: ID,ID; default 0")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->type_name("ID");
  command.add_option("--json", options.json, "write the figures to this file")->type_name("FILE");
  command.add_option("--forces", options.forces, "write one line per answered slot to this CSV")
      ->type_name("FILE");
  command
      .add_option("--snapshots", options.snapshots,
                  "write each body's surface before and after as BODY_before.vtk, BODY_after.vtk")
      ->type_name("DIR");
  command
      .add_option("--snapshots-at", options.snapshots_at,
                  "… and at these times of the run [s], as BODY_at_030.vtk")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::Range(0.0, 1e5))
      ->needs("--snapshots")
      ->type_name("T,T");
  add_force_option(command, options.force);
  command.add_option("--min-answered", options.min_answered, "share of slots below which the run has failed")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  command.add_flag(
      "--watch-machine", options.watch_machine,
      "note when the machine itself stands still, by a bare timer thread on every core, and judge "
      "the answers without the slots that such a stall strikes");
  command.add_option("--arm-wait", options.client.arm_timeout, "how long to wait for its force [s]")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  command.add_option("--wait", options.client.match_timeout, "how long to wait for a daemon [s]")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
}

void add_units_option(CLI::App& command, LengthUnit& units, const std::string& text) {
  const std::map<std::string, LengthUnit> names{{"m", LengthUnit::metre}, {"mm", LengthUnit::millimetre}};
  command.add_option("--units", units, text)
      ->transform(CLI::CheckedTransformer(names).description(""))
      ->type_name("m|mm");
}

void require_forces(const SessionOptions& options, const std::string& file,
                    const std::vector<std::string>& inputs) {
  OutputRule(options.force).require_table("--forces", file, force_row_header);
  // The forces of an earlier run are a recording too.
  for (const std::string& input : inputs)
    if (std::error_code error; !options.force && std::filesystem::equivalent(file, input, error))
      throw InputError(file, 0, "--forces", "is what this run reads; --force writes over it");
}

void prepare(SessionOptions& options, const std::vector<std::string>& inputs) {
  const std::set<std::uint32_t> distinct(options.devices.begin(), options.devices.end());
  if (distinct.size() < options.devices.size()) throw UsageError("--device-id: a device is named twice");
  if (!options.devices.empty() && options.devices.size() != std::max<std::size_t>(inputs.size(), 1))
    throw UsageError("--device-id: name as many devices as are to be played");
  if (!options.devices.empty()) options.client.device_id = options.devices.front();
  if (!options.secure.empty()) options.client.security = security_files(options.secure, options.role);
  const OutputRule rule(options.force);
  rule.require_figures("--json", options.json);
  require_forces(options, options.forces, inputs);
  rule.require_snapshots_folder("--snapshots", options.snapshots);
  std::sort(options.snapshots_at.begin(), options.snapshots_at.end());
  for (const std::string& file : {options.json, options.forces})
    if (const auto parent = std::filesystem::path(file).parent_path(); !parent.empty())
      std::filesystem::create_directories(parent);
  if (!options.snapshots.empty()) std::filesystem::create_directories(options.snapshots);
}

Session::Session(const SessionOptions& options, std::int64_t slots)
    : domain(options.client.domain, default_dds_profile()),
      participant(domain, options.client.security),
      monitor(participant, options.client.device_id),
      client(participant, options.client, slots) {}

std::optional<WatchedMachine> while_watching(const SessionOptions& options,
                                             const std::function<void()>& play) {
  if (!options.watch_machine) {
    play();
    return std::nullopt;
  }
  StallWatch watch;
  play();
  return watch.stop();
}

void run(Session& session, const SessionOptions& options, SlotSource& source, const std::string& what) {
  Progress progress(what);
  const auto slots = static_cast<double>(session.client.book().scheduled());
  bool announced = false;
  session.monitor.keep_at(options.snapshots_at);
  const auto poll = [&](std::int64_t reached) {
    session.monitor.poll_at(1e-3 * static_cast<double>(reached));
    if (reached < 0) {
      progress.show(0, "arming");
      return;
    }
    if (const Grant& grant = session.client.grant(); !announced && !grant.granted)
      std::fprintf(stderr, "haptic: %s refused: %s\n", grant.what.c_str(), grant.detail.c_str());
    announced = true;
    progress.show(static_cast<double>(reached + 1) / slots,
                  fixed(session.client.newest_force(), 3) + " N, " +
                      std::to_string(session.monitor.newest().elements_removed) + " removed");
  };
  session.machine = while_watching(options, [&] { session.client.run(source, poll); });
  for (int i = 0; i < 15; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    session.monitor.poll();
  }
}

void report(const Played& played, const SessionOptions& options, nlohmann::ordered_json& json, Table& table) {
  const DeviceClient& client = played.client;
  const SlotBook& book = client.book();
  double peak = 0, penetration = 0, energy = 0;
  std::int64_t in_contact = 0;
  DroppedContacts dropped;
  std::vector<double> age, wake, solve;
  for_each_answer(client, [&](std::int64_t, const hapticd_msg_ForceCommand& m) {
    const double force = force_of(m).norm();
    peak = std::max(peak, force);
    penetration = std::max(penetration, static_cast<double>(m.penetration_um));
    energy = std::min(energy, static_cast<double>(m.energy));
    in_contact += force > contact_force;
    dropped.note(m.contacts, m.dropped, (m.status & status_contacts_dropped) != 0);
    age.push_back(m.state_age_us);
    wake.push_back(m.wake_us);
    solve.push_back(m.solve_us);
  });
  for (const StatusRecord& s : played.monitor.all()) dropped.note_samples(s.samples, s.samples_dropped);
  const StatusRecord status = played.monitor.newest();
  const Quantiles round_trip = quantiles(book.round_trip_us());
  const Quantiles late = quantiles(book.lateness_us());
  const double answered = share(book.answered(), book.scheduled());

  json["domain"] = options.client.domain;
  json["device_id"] = client.device_id();
  json["scene"] = status.scene;
  json["complete"] = client.complete();
  json["slots_scheduled"] = book.scheduled();
  json["slots_sent"] = book.sent();
  json["slots_answered"] = book.answered();
  json["answered_share"] = rounded(answered, 5);
  json["began_ns"] = book.plan().time_of(0);
  if (played.machine) {
    json["machine_stalls"] = to_json(*played.machine);
    json["answered_between_stalls"] = rounded(answered_between_stalls(book, played.machine->stalls), 5);
  }
  json["answers_repeated"] = book.repeats();
  json["rtt_us"] = to_json(round_trip);
  json["rtt_from_intended_us"] = to_json(quantiles(book.intended_round_trip_us()));
  json["send_late_us"] = to_json(late);
  json["state_age_us"] = to_json(quantiles(age));
  json["wake_us"] = to_json(quantiles(wake));
  json["solve_us"] = to_json(quantiles(solve));
  json["force_peak_n"] = peak;
  json["penetration_max_um"] = penetration;
  json["energy_observed_min_j"] = energy;  // by the daemon, in the force messages
  json["contact_share"] = rounded(share(in_contact, book.answered()), 5);
  json["contacts_dropped"] = dropped.to_json();
  json["armed_again"] = client.armed_again();
  json["status_seen"] = client.status_seen();
  json["status_seen_text"] = status_text(client.status_seen());
  json["second_daemon"] = client.second_daemon();
  json["elements_removed"] = status.elements_removed;
  json["fragments_aspirated"] = status.fragments_aspirated;
  json["phase_shift_us"] = rounded(client.phase_shift_us(), 1);
  json["realtime"] = client.grant().granted;

  table.emplace_back("scene", status.scene.empty() ? "(no status heard)" : status.scene);
  table.emplace_back("slots scheduled / sent / answered",
                     std::to_string(book.scheduled()) + " / " + std::to_string(book.sent()) + " / " +
                         std::to_string(book.answered()) + "  (" + fixed(100 * answered, 2) + " % answered)");
  if (played.machine)
    table.emplace_back("the machine stood still",
                       to_text(*played.machine) + "; " +
                           fixed(100 * answered_between_stalls(book, played.machine->stalls), 2) +
                           " % answered between");
  table.emplace_back("round trip", to_text(round_trip, "µs"));
  table.emplace_back("sent late by", to_text(late, "µs"));
  table.emplace_back("state age at the tick", to_text(quantiles(age), "µs"));
  table.emplace_back("force, peak", fixed(peak, 4) + " N");
  table.emplace_back("in contact", fixed(100 * share(in_contact, book.answered()), 1) + " % of the answers");
  dropped.tabulate(table);
  table.emplace_back("elements removed", std::to_string(status.elements_removed));
  table.emplace_back("fragments aspirated", std::to_string(status.fragments_aspirated));
  table.emplace_back("status bits seen", status_text(client.status_seen()));
  if (client.armed_again() > 0)
    table.emplace_back("held up, and armed again", std::to_string(client.armed_again()) + " times");
  table.emplace_back("client's scheduling", client.grant().granted ? client.grant().what : "ordinary");
}

std::string forces_csv(const Played& played) {
  const DeviceClient& client = played.client;
  std::string text = force_row_header;
  for_each_answer(client, [&](std::int64_t k, const hapticd_msg_ForceCommand& m) {
    const std::int64_t arrived = client.book().answered_ns(k);
    ForceRow row;
    row.slot = k;
    row.sent = client.command(k);
    row.force = force_of(m);
    row.torque = {m.torque[0], m.torque[1], m.torque[2]};
    row.status = m.status;
    row.rtt_us = 1e-3 * static_cast<double>(arrived - client.book().sent_ns(k));
    row.state_age_us = m.state_age_us;
    row.problem_age_ms = m.problem_age_ms;
    row.wake_us = m.wake_us;
    row.solve_us = m.solve_us;
    row.contacts = m.contacts;
    row.active = m.active;
    row.penetration_um = m.penetration_um;
    row.removed = played.monitor.at(arrived).elements_removed;
    append(text, row);
  });
  return text;
}

// The first slot of those at the end that were answered without force, all of them; −1: there are none.
std::int64_t disarmed_since(const DeviceClient& client) {
  std::int64_t since = -1;
  for_each_answer(client, [&](std::int64_t k, const hapticd_msg_ForceCommand& m) {
    if (!(m.status & (status_disarmed | status_latched)))
      since = -1;
    else if (since < 0)
      since = k;
  });
  return since;
}

std::string fault_of(const Played& played, const SessionOptions& options) {
  const DeviceClient& client = played.client;
  if (client.second_daemon())
    return "two daemons, or one and somebody who plays one, serve device " +
           std::to_string(client.device_id()) + " in domain " + std::to_string(options.client.domain) +
           ": stop one of the two";
  if (!client.complete()) return "interrupted before the end";
  // Slots at the end that were answered without force count as unanswered; where the machine is watched, a
  // stall may have let the device go, and is judged apart.
  const std::int64_t since = options.client.enable && !played.machine ? disarmed_since(client) : -1;
  if (since >= 0 && share(since, client.book().scheduled()) < options.min_answered)
    return "disarmed from " + fixed(1e-3 * static_cast<double>(since), 3) +
           " s on and never armed again: no force was felt after that (the client or the machine paused for "
           "100 "
           "ms, or the daemon latched: its log says which)";
  const double answered = played.machine ? answered_between_stalls(client.book(), played.machine->stalls)
                                         : share(client.book().answered(), client.book().scheduled());
  if (answered >= options.min_answered) return "";
  return "only " + fixed(100 * answered, 1) + " % of the slots " +
         (played.machine ? "that no stall of the machine struck " : "") + "were answered, " +
         fixed(100 * options.min_answered, 1) + " % are asked for" +
         (client.status_seen() & status_latched ? "; the daemon latched the device, its log says why" : "");
}

int finish(const Session& session, const SessionOptions& options, const nlohmann::ordered_json& json,
           const Table& table) {
  if (!options.json.empty()) write_json(options.json, json);
  if (!options.forces.empty()) write_file(options.forces, forces_csv(session));
  if (!options.snapshots.empty()) session.monitor.write_surfaces(options.snapshots);
  print(table);
  const std::string fault = fault_of(session, options);
  if (!fault.empty()) std::fprintf(stderr, "haptic: %s\n", fault.c_str());
  return fault.empty() ? 0 : 1;
}

}  // namespace hapticd
