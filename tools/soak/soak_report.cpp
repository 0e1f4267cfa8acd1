#include "tools/soak/soak_report.h"

#include <algorithm>

#include "tools/cli/report.h"
#include "tools/soak/soak_drift.h"

namespace hapticd {
namespace {

using Json = nlohmann::ordered_json;

Json histograms(const SoakFigures& f) {
  Json j;
  j["wake_us"] = to_bins(f.tick.wake_us);
  j["timer_us"] = to_bins(f.tick.timer_us);
  j["cyclictest_us"] = to_bins(f.cyclictest_us);
  j["compute_us"] = to_bins(f.tick.solve_us);
  j["dds_write_us"] = to_bins(f.tick.write_us);
  j["state_age_us"] = to_bins(f.tick.state_age_us);
  j["problem_age_ms"] = to_bins(f.tick.problem_age_ms);
  j["rtt_us"] = to_bins(f.event.rtt_us);
  j["rtt_tick_us"] = to_bins(f.tick.rtt_us);
  return j;
}

double share(std::int64_t part, std::int64_t whole) {
  return whole > 0 ? static_cast<double>(part) / static_cast<double>(whole) : 0;
}

std::string judged(const SoakCheck& c) {
  if (!c.known) return "not measured";
  const int digits = c.at_most ? 3 : 5;
  std::string text = fixed(c.value, digits) + (c.at_most ? " ≤ " : " ≥ ") + fixed(c.limit, digits);
  if (c.strays)
    text += " (by the choice of blocks " + fixed(c.strays->low, digits) + " to " +
            fixed(c.strays->high, digits) + ")";
  return text;
}

Json minutes(const SoakRecord& r) {
  Json list = Json::array();
  for (const SoakFigures& m : r.minutes)
    list.push_back({{"wake_us", to_json(m.tick.wake_us)},
                    {"timer_us", to_json(m.tick.timer_us)},
                    {"cyclictest_us", to_json(m.cyclictest_us)},
                    {"compute_us", to_json(m.tick.solve_us)},
                    {"state_age_us", to_json(m.tick.state_age_us)},
                    {"rtt_us", to_json(m.event.rtt_us)},
                    {"ddsperf_p50_us", rounded(m.ddsperf.p50(), 2)},
                    {"ddsperf_p99_us", rounded(m.ddsperf.p99(), 2)},
                    {"rss_mb", rounded(m.rss_mb, 2)}});
  return list;
}

}  // namespace

// Bounds of what no block has by itself.
std::vector<SoakCheck> check_whole(const SoakRecord& r, std::int64_t allocations, bool counted,
                                   std::int64_t faults, Json& drift) {
  std::vector<SoakCheck> checks;
  if (!r.own) return checks;
  checks.push_back({"allocations in haptic code", static_cast<double>(allocations), 0, true, counted});
  checks.push_back({"page faults after arming", static_cast<double>(faults), 0});
  drift = check_drift(r, checks);
  return checks;
}

Json soak_report(const SoakRecord& r, SoakVerdict& verdict) {
  const ServerFigures& tick = r.all.tick;
  const ServerFigures& event = r.all.event;
  const bool ticked = tick.scheduled > 0, evented = event.scheduled > 0;
  ServerFigures both = tick;
  both.merge(event);
  Json j;
  j["command"] = "soak";
  j["scene"] = r.scene;
  j["mode"] = r.mode;
  j["duration_s"] = r.duration;
  j["load_percent"] = r.load;
  j["cpu_busy_percent"] = rounded(100 * r.busy, 1);
  j["steal_percent"] = rounded(100 * r.steal, 3);
  j["slots"] = {{"scheduled", both.scheduled}, {"sent", both.sent}, {"answered", both.answered}};
  j["answered_share"] = rounded(share(both.answered, both.scheduled), 5);
  const bool tool_woken = r.all.cyclictest_us.count() > 0;
  j["cyclictest_on_time_share"] = tool_woken ? Json(rounded(on_time(r.all.cyclictest_us), 5)) : Json();
  // Of the fixed tick where there is one; the round trip of the events where there are.
  const ServerFigures& main = ticked ? tick : event;
  j["wake_us"] = to_json(main.wake_us);
  j["timer_us"] = to_json(main.timer_us);
  j["cyclictest_us"] = to_json(r.all.cyclictest_us);
  j["compute_us"] = to_json(main.solve_us);
  j["dds_write_us"] = to_json(main.write_us);
  j["rtt_us"] = to_json(evented ? event.rtt_us : tick.rtt_us);
  // What is left when the contact solve of each answer is taken away: the way, both directions.
  j["rtt_less_compute_us"] = to_json(evented ? event.rtt_less_compute_us : tick.rtt_less_compute_us);
  const bool pinged = r.all.ddsperf.count > 0;
  const auto or_null = [](bool known, double v, int digits = 2) {
    return known ? Json(rounded(v, digits)) : Json();
  };
  j["ddsperf_us"] = {{"p50", or_null(pinged, r.all.ddsperf.p50())},
                     {"p99", or_null(pinged, r.all.ddsperf.p99())},
                     {"max", or_null(pinged, r.all.ddsperf.max)},
                     {"count", r.all.ddsperf.count}};
  const bool woken = ticked && tool_woken;
  const auto over = [](double a, double b) { return b > 0 ? a / b : 0; };
  const double wake_p99 = over(tick.wake_us.percentile(99), r.all.cyclictest_us.percentile(99));
  const double wake_p99_9 = over(tick.wake_us.percentile(99.9), r.all.cyclictest_us.percentile(99.9));
  // The loop wakes early (haptic/loop.h): what its sleep alone is late by, as the public tool's is.
  const bool slept = woken && tick.timer_us.count() > 0;
  const auto timer = [&](double percent) {
    return or_null(slept, over(tick.timer_us.percentile(percent), r.all.cyclictest_us.percentile(percent)),
                   3);
  };
  const double rtt_p50 = over(event.rtt_us.percentile(50), r.all.ddsperf.p50());
  j["ratio"] = {
      {"wake_p99", or_null(woken, wake_p99, 3)},
      {"wake_p99_9", or_null(woken, wake_p99_9, 3)},
      {"timer_p99", timer(99)},
      {"timer_p99_9", timer(99.9)},
      {"rtt_p50", or_null(evented && pinged, rtt_p50, 3)},
      {"rtt_less_compute_p50",
       or_null(evented && pinged, over(event.rtt_less_compute_us.percentile(50), r.all.ddsperf.p50()), 3)}};
  j["state_age_us"] = to_json(main.state_age_us);
  j["problem_age_ms"] = to_json(main.problem_age_ms);
  j["sim_rate_hz"] = to_json(main)["sim_rate_hz"];
  j["deadline_misses"] = both.misses;
  j["longest_gap_ms"] = rounded(1e-3 * both.interval_us.max(), 3);
  j["force_peak_n"] = both.force_peak;

  std::int64_t allocations = 0, port = 0, faults = 0;
  bool counted = r.own;
  Json refused = Json::array();
  for (const nlohmann::json& s : r.summaries) {
    counted = counted && s.contains("allocations_in_haptic_code");
    allocations += s.value("allocations_in_haptic_code", std::int64_t{0});
    port += s.value("allocations_in_device_port", std::int64_t{0});
    faults += s.value("page_faults", std::int64_t{0});
    for (const auto& grant : s.at("grants"))
      if (!grant.at("granted").get<bool>()) refused.push_back(grant.at("what").get<std::string>());
  }
  j["allocations_in_haptic_code"] = counted ? Json(allocations) : Json();
  j["allocations_in_device_port"] = counted ? Json(port) : Json();
  j["page_faults"] = r.own ? Json(faults) : Json();
  j["refused"] = refused;
  j["rss_mb"] = {{"start", rounded(r.first_rss_mb, 2)}, {"end", rounded(r.minutes.back().rss_mb, 2)}};

  verdict = judge(r, check_whole(r, allocations, counted, faults, j["drift"]));
  j["checks"] = to_json(verdict.checks);
  j["machine"] = {{"fit", verdict.fit},
                  {"cyclictest_on_time_share", j.at("cyclictest_on_time_share")},
                  {"bound", fit_limit}};
  j["realtime_neighbours"] = to_json(r.neighbours);
  j["verdict"] = to_text(verdict.outcome);
  j["confidence"] = verdict.confidence ? Json(rounded(*verdict.confidence, 3)) : Json();
  if (ticked) j["tick"] = to_json(tick);
  if (evented) j["event"] = to_json(event);
  j["minutes"] = minutes(r);
  j["histograms"] = histograms(r.all);
  return j;
}

Json to_json(const std::vector<SoakCheck>& checks) {
  Json list = Json::array();
  for (const SoakCheck& c : checks) {
    list.push_back({{"what", c.what},
                    {"value", c.known ? Json(rounded(c.value, 4)) : Json()},
                    {"limit", rounded(c.limit, 4)},
                    {"kept", c.kept()}});
    if (c.strays) list.back()["ci90"] = {rounded(c.strays->low, 4), rounded(c.strays->high, 4)};
    if (!c.kept() && c.unfit_limit) list.back()["limit_of_an_unfit_machine"] = rounded(*c.unfit_limit, 4);
  }
  return list;
}

void print_soak(const Json& j, const SoakVerdict& verdict, const std::vector<Neighbour>& neighbours) {
  Table table;
  const auto quantiles_of = [&](const char* key, const char* name, const char* unit) {
    const Json& q = j.at(key);
    if (q.at("p50").is_null()) return;
    const auto number = [&](const char* k) {
      return q.contains(k) && !q[k].is_null() ? fixed(q[k].get<double>(), 1) : "–";
    };
    table.emplace_back(name, "p50 " + number("p50") + ", p99 " + number("p99") + ", p99.9 " +
                                 number("p99_9") + ", max " + number("max") + " " + unit);
  };
  quantiles_of("wake_us", "wake-up, late by", "µs");
  quantiles_of("timer_us", "its timer", "µs");
  quantiles_of("cyclictest_us", "cyclictest", "µs");
  quantiles_of("compute_us", "haptic step", "µs");
  quantiles_of("dds_write_us", "write over DDS", "µs");
  quantiles_of("state_age_us", "state age", "µs");
  quantiles_of("problem_age_ms", "problem age", "ms");
  quantiles_of("rtt_us", "round trip", "µs");
  quantiles_of("rtt_less_compute_us", "… less the haptic step", "µs");
  quantiles_of("ddsperf_us", "ddsperf round trip", "µs");
  const Json& s = j.at("slots");
  table.emplace_back(
      "slots scheduled / sent / answered",
      s.at("scheduled").dump() + " / " + s.at("sent").dump() + " / " + s.at("answered").dump());
  if (const Json& on_time = j.at("cyclictest_on_time_share"); !on_time.is_null())
    table.emplace_back("answered; cyclictest's less than 1 ms late",
                       j.at("answered_share").dump() + "; " + on_time.dump());
  table.emplace_back("deadline misses, longest gap",
                     j.at("deadline_misses").dump() + ", " + j.at("longest_gap_ms").dump() + " ms");
  table.emplace_back("simulation", j.at("sim_rate_hz").dump() + " Hz");
  table.emplace_back("processors busy, stolen",
                     j.at("cpu_busy_percent").dump() + " %, " + j.at("steal_percent").dump() + " %");
  table.emplace_back("memory",
                     j.at("rss_mb").at("start").dump() + " → " + j.at("rss_mb").at("end").dump() + " MB");
  if (!neighbours.empty()) table.emplace_back("others on the loop's core", to_text(neighbours));
  for (const SoakCheck& c : verdict.checks)
    table.emplace_back((c.kept() ? "ok    " : c.known ? "FAIL  " : "none  ") + c.what, judged(c));
  print(table);
}

}  // namespace hapticd
