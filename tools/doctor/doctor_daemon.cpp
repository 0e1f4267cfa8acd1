// The part of `haptic doctor` that looks at a running daemon: its instruments, their devices and clients.
#include <cstdio>
#include <map>
#include <set>

#include <unistd.h>

#include "haptic/clock.h"
#include "haptic/device.h"
#include "server/dds/dds.h"
#include "tools/client/client.h"
#include "tools/doctor/doctor.h"
#include "tools/record/instrument_list.h"

namespace hapticd {
namespace {

constexpr double patience = 3;  // [s]
constexpr std::int64_t listening_ns = 1'000'000'000;
constexpr double fewest_states = 500;  // a second, of a client that a hand feels
// What keeps a force from the hand, or takes it away.
constexpr std::uint32_t faults = status_problem_lost | status_latched | status_not_finite | status_rival;

struct Heard {
  std::uint32_t status = status_disarmed;
  double haptic_hz = 0, simulation_hz = 0;
  std::string scene, device;
  int states = 0;
  std::set<dds_instance_handle_t> clients;
};

std::string rate(double hz) {
  char text[32];
  std::snprintf(text, sizeof text, "%.0f", hz);
  return text;
}

// What is heard of each device within a second.
std::map<std::uint32_t, Heard> listen(const Participant& participant, double& seconds) {
  Reader<hapticd_msg_ServerStatus> status(participant);
  Reader<hapticd_msg_ServerHealth> health(participant);
  Reader<hapticd_msg_DeviceState> states(participant);
  std::map<std::uint32_t, Heard> heard;
  usleep(300'000);  // until clients have found the reader
  states.take_each([](const hapticd_msg_DeviceState&, const dds_sample_info_t&) {});
  const std::int64_t begun = monotonic_ns();
  while (monotonic_ns() - begun < listening_ns) {
    status.take_each([&](const hapticd_msg_ServerStatus& m, const dds_sample_info_t&) {
      Heard& of = heard[m.device_id];
      of.status = m.status;
      of.haptic_hz = static_cast<double>(m.haptic_rate_hz);
      of.simulation_hz = static_cast<double>(m.sim_rate_hz);
      of.scene = m.scene ? m.scene : "";
    });
    health.take_each([&](const hapticd_msg_ServerHealth& m, const dds_sample_info_t&) {
      heard[m.device_id].device = m.device ? m.device : "";
    });
    states.take_each([&](const hapticd_msg_DeviceState& m, const dds_sample_info_t& info) {
      Heard& of = heard[m.device_id];
      ++of.states;
      of.clients.insert(info.publication_handle);
    });
    usleep(1000);
  }
  seconds = 1e-9 * static_cast<double>(monotonic_ns() - begun);
  return heard;
}

Finding finding_of(const std::string& name, std::uint32_t id, const Heard& h, double seconds) {
  Finding f{name, Health::pass, "device " + std::to_string(id) + (h.device.empty() ? "" : ", " + h.device) + ": ",
            ""};
  const double states = h.states / seconds;
  if (h.clients.empty()) {
    f.found += "no client";
    return f;
  }
  f.found += (h.clients.size() == 1 ? "a client" : std::to_string(h.clients.size()) + " clients") + ", " +
             rate(states) + " states a second, " +
             (h.status & status_disarmed ? "not armed" : h.status == 0 ? "armed" : "armed, " + status_text(h.status));
  if (h.clients.size() > 1) {
    f.health = Health::warn;
    f.fix = "stop all but one: the daemon keeps to the first that it heard";
  } else if (h.status & faults) {
    f.health = Health::warn;
    f.fix = "idl/README.md names the bits; a client arms again by enable false, then true";
  } else if (states < fewest_states) {
    f.health = Health::warn;
    f.fix = "a client sends a state each millisecond";
  }
  return f;
}

}  // namespace

std::vector<Finding> check_daemon(std::uint32_t domain_id, const std::optional<Security>& security) {
  constexpr const char* profile = "loopback";
  try {
    const Domain domain(domain_id, read_dds_profile(profile));
    const Participant participant(domain, security);
    InstrumentList list(participant);
    if (!list.await(patience))
      return {{"daemon", Health::fail, "no daemon answers in " + dds_place(domain_id, profile),
               "start one: hapticd SCENE.yaml --domain " + std::to_string(domain_id)}};
    double seconds = 1;
    std::map<std::uint32_t, Heard> heard = listen(participant, seconds);
    const std::vector<HeardInstrument> instruments = list.all();
    const Heard& first = heard[instruments.front().device_id];
    const std::size_t n = instruments.size();
    std::vector<Finding> out = {
        {"daemon", Health::pass,
         dds_place(domain_id, profile) + ": " + first.scene + ", " + std::to_string(n) +
             (n > 1 ? " instruments in one tissue, solved together" : " instrument") + ", " +
             rate(first.haptic_hz) + " forces and " + rate(first.simulation_hz) + " steps a second",
         ""}};
    for (const HeardInstrument& i : instruments) {
      out.push_back(finding_of(i.name, i.device_id, heard[i.device_id], seconds));
      heard.erase(i.device_id);
    }
    for (const auto& [id, h] : heard)
      out.push_back(h.scene.empty()
                        ? Finding{"stranger", Health::warn,
                                  "a client plays device " + std::to_string(id) + ", which no instrument has",
                                  "name the scene's device: --device-id"}
                        : finding_of("more_devices", id, h, seconds));
    return out;
  } catch (const std::exception& e) {
    return {{"daemon", Health::fail, e.what(), "see config/dds, and --secure for a daemon that has keys"}};
  }
}

}  // namespace hapticd
