#include "tools/soak/public_tools.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>

#include "server/files/paths.h"
#include "server/os/realtime.h"
#include "tools/cli/child.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/report.h"
#include "tools/client/client.h"

namespace hapticd {
namespace {

constexpr int histogram_us = 30'000;  // longer ones are read from the maximum

std::string content(const std::string& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

void PingFigures::add(double p50, double p99, double largest, std::uint64_t n) {
  count += n;
  p50_sum += p50 * static_cast<double>(n);
  p99_sum += p99 * static_cast<double>(n);
  max = std::max(max, largest);
}

void PingFigures::merge(const PingFigures& o) {
  count += o.count;
  p50_sum += o.p50_sum;
  p99_sum += o.p99_sum;
  max = std::max(max, o.max);
}

Tally read_cyclictest(const std::string& output) {
  Tally late;
  double largest = 0;
  long long overflows = 0;
  std::istringstream lines(output);
  for (std::string line; std::getline(lines, line);) {
    int us = 0;
    unsigned long long n = 0;
    if (std::sscanf(line.c_str(), "%d %llu", &us, &n) == 2) late.add(us, n);
    std::sscanf(line.c_str(), "# Max Latencies: %lf", &largest);
    std::sscanf(line.c_str(), "# Histogram Overflows: %lld", &overflows);
  }
  if (overflows > 0) late.add(largest, static_cast<std::uint64_t>(overflows));
  if (late.count() == 0) throw std::runtime_error("cyclictest gave no histogram: " + output.substr(0, 300));
  return late;
}

Tally with_hidden_wakeups(const Tally& late_us, double period_us) {
  Tally all;
  for (const auto& [late, n] : late_us.bins())
    for (double l = late; l >= 0; l -= period_us) all.add(l, n);
  return all;
}

PingFigures read_ddsperf(const std::string& output) {
  PingFigures figures;
  std::istringstream lines(output);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t at = line.find(" mean ");
    if (at == std::string::npos) continue;
    double mean = 0, least = 0, p50 = 0, p90 = 0, p99 = 0, most = 0;
    unsigned long long n = 0;
    if (std::sscanf(line.c_str() + at,
                    " mean %lfus min %lfus 50%% %lfus 90%% %lfus 99%% %lfus max %lfus cnt %llu", &mean,
                    &least, &p50, &p90, &p99, &most, &n) == 7)
      figures.add(2 * p50, 2 * p99, 2 * most, n);
  }
  if (figures.count == 0) throw std::runtime_error("ddsperf gave no round trips: " + output.substr(0, 300));
  return figures;
}

Tally run_cyclictest(double seconds, int core, int priority, const std::string& scratch) {
  const std::string file = scratch + "/cyclictest.txt";
  // Its -D takes whole seconds; loops at 1 kHz are finer.
  Child child(
      {.command = {"cyclictest", "--quiet", "--mlockall", "--threads=1", "--interval=1000", "--policy=fifo",
                   "--priority=" + std::to_string(priority), "--affinity=" + std::to_string(core),
                   "--loops=" + std::to_string(static_cast<long>(1e3 * seconds)),
                   "--histogram=" + std::to_string(histogram_us)},
       .output = file});
  for (double t = 0; child.running() && t < seconds + 10 && !interrupted(); t += 0.05) usleep(50'000);
  return read_cyclictest(content(file));
}

PingFigures run_ddsperf(double seconds, int pong_core, int ping_core, int domain,
                        const std::string& scratch) {
  const std::string profile = realtime_allowed() ? "loopback_realtime" : "loopback";
  const std::string uri = "CYCLONEDDS_URI=file://" + config_file("dds/" + profile + ".xml").string();
  const int whole = std::max(1, static_cast<int>(seconds));
  const std::string id = std::to_string(domain), file = scratch + "/ddsperf.txt";
  Child pong({.command = {"ddsperf", "-i", id, "-u", "-D", std::to_string(whole + 10), "pong"},
              .output = scratch + "/ddsperf_pong.txt",
              .environment = {uri},
              .fifo_priority = haptic_priority,
              .core = pong_core});
  usleep(300'000);
  Child ping({.command = {"ddsperf", "-i", id, "-u", "-D", std::to_string(whole), "ping", "1kHz", "size",
                          std::to_string(sizeof(hapticd_msg_DeviceState))},
              .output = file,
              .environment = {uri},
              .fifo_priority = ClientSettings{}.fifo_priority,
              .core = ping_core});
  for (double t = 0; ping.running() && t < whole + 8 && !interrupted(); t += 0.05) usleep(50'000);
  return read_ddsperf(content(file));
}

}  // namespace hapticd
