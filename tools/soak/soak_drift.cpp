#include "tools/soak/soak_drift.h"

#include <algorithm>

#include "tools/cli/report.h"

namespace hapticd {
namespace {

constexpr std::size_t drift_from_minutes = 3;
constexpr double p50_limit = 1.25, p99_limit = 1.5, p99_9_limit = 2, growth_limit_mb = 2;

using Value = double (*)(const SoakFigures&);

struct Series {
  const char* key;
  const char* what;
  Value ours;
  Value theirs;  // the public tool's; null: none
  double limit;
};

// Below a microsecond it is the time that reading the clock takes.
double wake(const SoakFigures& m, double percent) {
  return std::max(1.0, m.tick.wake_us.percentile(percent));
}

double timer(const SoakFigures& m, double percent) { return m.tick.timer_us.percentile(percent); }
double tool(const SoakFigures& m, double percent) { return m.cyclictest_us.percentile(percent); }

constexpr Series of_tick[] = {
    {"wake_p50", "wake p50", [](const SoakFigures& m) { return wake(m, 50); },
     [](const SoakFigures& m) { return tool(m, 50); }, p50_limit},
    {"wake_p99", "wake p99", [](const SoakFigures& m) { return wake(m, 99); },
     [](const SoakFigures& m) { return tool(m, 99); }, p99_limit},
    {"wake_p99_9", "wake p99.9", [](const SoakFigures& m) { return wake(m, 99.9); },
     [](const SoakFigures& m) { return tool(m, 99.9); }, p99_9_limit},
    {"timer_p50", "timer p50", [](const SoakFigures& m) { return timer(m, 50); },
     [](const SoakFigures& m) { return tool(m, 50); }, p50_limit},
    {"timer_p99", "timer p99", [](const SoakFigures& m) { return timer(m, 99); },
     [](const SoakFigures& m) { return tool(m, 99); }, p99_limit},
    {"timer_p99_9", "timer p99.9", [](const SoakFigures& m) { return timer(m, 99.9); },
     [](const SoakFigures& m) { return tool(m, 99.9); }, p99_9_limit},
    {"compute_p50", "haptic step p50", [](const SoakFigures& m) { return m.tick.solve_us.percentile(50); },
     nullptr, p50_limit},
    {"compute_p99", "haptic step p99", [](const SoakFigures& m) { return m.tick.solve_us.percentile(99); },
     nullptr, p99_limit},
    {"state_age_p99", "state age p99",
     [](const SoakFigures& m) { return m.tick.state_age_us.percentile(99); }, nullptr, p99_limit},
};
constexpr Series of_event[] = {
    {"rtt_p50", "round trip p50", [](const SoakFigures& m) { return m.event.rtt_us.percentile(50); },
     [](const SoakFigures& m) { return m.ddsperf.p50(); }, p50_limit},
    {"rtt_p99", "round trip p99", [](const SoakFigures& m) { return m.event.rtt_us.percentile(99); },
     [](const SoakFigures& m) { return m.ddsperf.p99(); }, p99_limit},
};

double drift_of(const std::vector<SoakFigures>& minutes, Value value) {
  const Thirds t = thirds(minutes, value);
  return drift(t.first, t.last);
}

}  // namespace

double drift(const std::vector<double>& first, const std::vector<double>& last) {
  if (first.empty() || last.empty()) return 1;
  const double a = quantiles(first).p50, b = quantiles(last).p50;
  return a > 0 && b > 0 ? std::max(a / b, b / a) : 1;
}

nlohmann::ordered_json check_drift(const SoakRecord& r, std::vector<SoakCheck>& checks) {
  if (r.minutes.size() < drift_from_minutes) return {};
  nlohmann::ordered_json j;
  const auto check = [&](const Series& s) {
    const double ours = drift_of(r.minutes, s.ours), theirs = s.theirs ? drift_of(r.minutes, s.theirs) : 1;
    j[s.key] = rounded(ours, 3);
    if (s.theirs) j[std::string(s.key) + "_of_the_tool"] = rounded(theirs, 3);
    checks.push_back({std::string(s.what) + ", last third / first", ours / std::max(1.0, theirs), s.limit,
                      true, true, granted_lateness * s.limit});
  };
  if (r.all.tick.scheduled > 0)
    for (const Series& s : of_tick) check(s);
  if (r.all.event.scheduled > 0)
    for (const Series& s : of_event) check(s);
  const Thirds memory = thirds(r.minutes, [](const SoakFigures& m) { return m.rss_mb; });
  const double growth = quantiles(memory.last).p50 - quantiles(memory.first).p50;
  j["memory_growth_mb"] = rounded(growth, 3);
  checks.push_back({"memory, last third − first [MB]", growth, growth_limit_mb});
  return j;
}

}  // namespace hapticd
