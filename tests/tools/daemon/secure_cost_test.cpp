// What security costs on the wire, measured: a state out and its answer back between two processes, the
// other one answering at once from SCHED_FIFO 80 where that is granted, 10 000 times at 1 kHz.
// A measurement, not a test: test_tools --gtest_also_run_disabled_tests --gtest_filter='SecureCost.*'
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <optional>
#include <vector>

#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "haptic/clock.h"
#include "server/dds/dds.h"
#include "server/os/realtime.h"
#include "tests/support/malloc_guard.h"
#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

constexpr int rounds = 10'000, warm_up = 500;
constexpr std::int64_t period_ns = 1'000'000;

template <typename In, typename Out>
struct End {
  Domain domain;
  Participant participant;
  Reader<In> reader;
  Writer<Out> writer;
  DdsEntity arrival;

  End(std::uint32_t domain_id, const std::optional<Security>& security)
      : domain(domain_id, default_dds_profile()),
        participant(domain, security),
        reader(participant),
        writer(participant),
        arrival(require(dds_create_waitset(participant.handle()), "a waitset")) {
    dds_set_status_mask(reader.handle(), DDS_DATA_AVAILABLE_STATUS);
    dds_waitset_attach(arrival.handle(), reader.handle(), 0);
  }
};

[[noreturn]] void answer(std::uint32_t domain, const std::optional<Security>& security) {
  const ScopedCore core(1);  // Cyclone's threads too, as in the daemon
  End<hapticd_msg_DeviceState, hapticd_msg_ForceCommand> end(domain, security);
  use_fifo(haptic_priority);
  long allocations = 0;  // of the write before
  for (;;) {
    dds_waitset_wait(end.arrival.handle(), nullptr, 0, DDS_SECS(1));
    end.reader.take_each([&](const hapticd_msg_DeviceState& state, const dds_sample_info_t&) {
      hapticd_msg_ForceCommand force{};
      force.echo_number = state.number;
      force.number = static_cast<std::uint64_t>(allocations);
      const MallocGuard guard;
      end.writer.write(force);
      allocations = guard.allocations();
    });
  }
}

struct Asked {
  std::vector<double> us;  // sorted
  std::uint64_t allocations = 0;
};

Asked ask(std::uint32_t domain, const std::optional<Security>& security) {
  End<hapticd_msg_ForceCommand, hapticd_msg_DeviceState> end(domain, security);
  use_fifo(50);
  while (!end.writer.matched() || !end.reader.matched()) usleep(10'000);
  sleep(1);
  Asked out;
  std::int64_t next = monotonic_ns();
  hapticd_msg_DeviceState state{};
  for (int k = 1; k <= rounds; ++k) {
    next += period_ns;
    const timespec t{next / 1'000'000'000, next % 1'000'000'000};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
    state.number = static_cast<std::uint64_t>(k);
    const std::int64_t sent = monotonic_ns();
    end.writer.write(state);
    bool back = false;
    while (!back && monotonic_ns() - sent < period_ns) {
      dds_waitset_wait(end.arrival.handle(), nullptr, 0, period_ns);
      end.reader.take_each([&](const hapticd_msg_ForceCommand& force, const dds_sample_info_t&) {
        back |= force.echo_number == state.number;
        out.allocations = force.number;
      });
    }
    if (back && k > warm_up) out.us.push_back(1e-3 * static_cast<double>(monotonic_ns() - sent));
  }
  std::sort(out.us.begin(), out.us.end());
  return out;
}

// Both ends are processes of their own.
void measure(const char* name, const std::string& keys) {
  const auto as = [&](const char* role) {
    return keys.empty() ? std::nullopt : std::optional(security_files(keys, role));
  };
  const auto domain = static_cast<std::uint32_t>(100 + getpid() % 100);
  const pid_t client = fork();
  if (client == 0) {
    const pid_t server = fork();
    if (server == 0) {
      prctl(PR_SET_PDEATHSIG, SIGKILL);
      answer(domain, as("daemon"));
    }
    const Asked asked = ask(domain, as("device"));
    const std::vector<double>& us = asked.us;
    const auto at = [&](double share) {
      return us[static_cast<std::size_t>(share * static_cast<double>(us.size() - 1))];
    };
    std::printf(
        "%-8s round trip p50 %.1f, p99 %.1f, p99.9 %.1f, max %.1f us, %zu of %d answered, %llu allocations a "
        "write\n",
        name, at(0.5), at(0.99), at(0.999), us.back(), us.size(), rounds - warm_up,
        static_cast<unsigned long long>(asked.allocations));
    std::fflush(stdout);
    kill(server, SIGKILL);
    _exit(0);
  }
  int status = 0;
  waitpid(client, &status, 0);
  EXPECT_EQ(status, 0);
}

TEST(SecureCost, DISABLED_RoundTripOfAState) {
  const ScratchDirectory scratch;
  const std::string keys = scratch.file("keys");
  ASSERT_EQ(run_command(SOURCE_DIR "/config/dds/security/make_keys.sh " + keys).code, 0);
  for (int round = 0; round < 2; ++round) {
    measure("plain", "");
    measure("secured", keys);
  }
}

}  // namespace
}  // namespace hapticd
