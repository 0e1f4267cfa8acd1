// The part of `haptic doctor` that is about DDS: a round trip between two processes.
#include <unistd.h>

#include <cstdio>

#include "haptic/clock.h"
#include "server/dds/dds.h"
#include "tools/cli/child.h"
#include "tools/doctor/doctor.h"

namespace hapticd {
namespace {

constexpr std::uint32_t nobodys_device = 4'000'000'000;  // beyond what a scene may name
constexpr const char* profile = "loopback";

}  // namespace

int answer_dds(std::uint32_t domain_id, double seconds) {
  const Domain domain(domain_id, read_dds_profile(profile));
  const Participant participant(domain);
  Reader<hapticd_msg_DeviceState> states(participant);
  Writer<hapticd_msg_ForceCommand> forces(participant);
  const std::int64_t end = monotonic_ns() + static_cast<std::int64_t>(1e9 * seconds);
  while (monotonic_ns() < end) {
    states.take_each([&](const hapticd_msg_DeviceState& state, const dds_sample_info_t&) {
      if (state.device_id != nobodys_device) return;
      hapticd_msg_ForceCommand force{};
      force.device_id = nobodys_device;
      force.echo_number = state.number;
      forces.write(force);
    });
    usleep(100);
  }
  return 0;
}

Finding check_dds(std::uint32_t domain_id) {
  constexpr double patience = 10;
  const std::string name = "DDS";
  const std::string where = "domain " + std::to_string(domain_id) + " on loopback";
  try {
    Child other(
        {.command = {std::filesystem::read_symlink("/proc/self/exe").string(), "doctor", "--answer-dds",
                     std::to_string(patience + 1), "--domain", std::to_string(domain_id)}});
    const Domain domain(domain_id, read_dds_profile(profile));
    const Participant participant(domain);
    Writer<hapticd_msg_DeviceState> states(participant);
    Reader<hapticd_msg_ForceCommand> forces(participant);
    const std::int64_t begun = monotonic_ns(), end = begun + static_cast<std::int64_t>(1e9 * patience);
    std::int64_t best = INT64_MAX, first = 0;
    int answers = 0;
    hapticd_msg_DeviceState state{};
    state.device_id = nobodys_device;
    state.orientation[3] = 1;
    while (monotonic_ns() < end && answers < 100 && other.running()) {
      ++state.number;
      const std::int64_t sent = monotonic_ns();
      states.write(state);
      bool back = false;
      while (!back && monotonic_ns() - sent < 5'000'000) {
        forces.take_each([&](const hapticd_msg_ForceCommand& force, const dds_sample_info_t&) {
          back = back || (force.device_id == nobodys_device && force.echo_number == state.number);
        });
        if (!back) usleep(20);
      }
      if (!back) continue;
      const std::int64_t now = monotonic_ns();
      if (answers++ == 0) first = now - begun;
      best = std::min(best, now - sent);
    }
    if (answers > 0) {
      char text[160];
      std::snprintf(text, sizeof text,
                    "%s: two processes found one another in %.0f ms, %d round trips, the best %.2f ms",
                    where.c_str(), 1e-6 * static_cast<double>(first), answers,
                    1e-6 * static_cast<double>(best));
      return {name, Health::pass, text, ""};
    }
    return {name, Health::fail, where + ": two processes do not hear one another within 10 s",
            "look for a firewall on lo (UDP ports 7400 and up), and for lo being up: ip link set lo up"};
  } catch (const std::exception& e) {
    return {name, Health::fail, where + ": " + e.what(),
            "see config/dds, and HAPTICD_CONFIG_DIR if it is set"};
  }
}

}  // namespace hapticd
