#include "tools/soak/soak_report.h"

#include <algorithm>

#include "tools/cli/report.h"
#include "tools/soak/soak_drift.h"

namespace hapticd {
namespace {

using Json = nlohmann::ordered_json;

// Bounds of the verdict: what the machine does to a public tool, times what we may add.
constexpr double wake_p99_limit = 1.2, wake_p99_9_limit = 1.5, rtt_p50_limit = 1.5, answered_limit = 0.999;

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

// Of the public tool's wake-ups, those less than a slot late: what the machine alone leaves of the slots.
double on_time(const Tally& late_us) {
  std::uint64_t kept = 0;
  for (const auto& [late, n] : late_us.bins())
    if (late < 1000) kept += n;
  return share(static_cast<std::int64_t>(kept), static_cast<std::int64_t>(late_us.count()));
}

std::string judged(const SoakCheck& c) {
  if (!c.known) return "not measured";
  const int digits = c.at_most ? 3 : 5;
  std::string text = fixed(c.value, digits) + (c.at_most ? " ≤ " : " ≥ ") + fixed(c.limit, digits);
  if (c.strays)
    text += " (by the choice of slices " + fixed(c.strays->low, 2) + " to " + fixed(c.strays->high, 2) + ")";
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

void SoakFigures::merge(const SoakFigures& o) {
  tick.merge(o.tick);
  event.merge(o.event);
  cyclictest_us.merge(o.cyclictest_us);
  ddsperf.merge(o.ddsperf);
  rss_mb = o.rss_mb;
}

Json soak_report(const SoakRecord& r, std::vector<SoakCheck>& checks) {
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

  const auto strays = [&](double percent) -> std::optional<Interval> {
    return woken ? bootstrap_ratio(r.wake_slices_us, r.cyclictest_slices_us, percent) : std::nullopt;
  };
  const std::optional<Interval> of_p99 = strays(99), of_p99_9 = strays(99.9);
  checks.push_back({"wake p99 / cyclictest", wake_p99, wake_p99_limit, true, woken || !ticked, of_p99});
  checks.push_back(
      {"wake p99.9 / cyclictest", wake_p99_9, wake_p99_9_limit, true, woken || !ticked, of_p99_9});
  const auto ends = [](const std::optional<Interval>& i) {
    return i ? Json{rounded(i->low, 3), rounded(i->high, 3)} : Json();
  };
  j["ratio_ci90"] = {{"wake_p99", ends(of_p99)}, {"wake_p99_9", ends(of_p99_9)}};
  if (evented) checks.push_back({"event round trip p50 / ddsperf", rtt_p50, rtt_p50_limit, true, pinged});
  checks.push_back(
      {"answered / scheduled", share(both.answered, both.scheduled), answered_limit, false, true});
  if (ticked)
    checks.push_back({"state age p99, tick [µs]", tick.state_age_us.percentile(99),
                      1000 + 2 * r.all.cyclictest_us.percentile(99), true, woken});
  if (r.own) {
    checks.push_back({"allocations in haptic code", static_cast<double>(allocations), 0, true, counted});
    checks.push_back({"page faults after arming", static_cast<double>(faults), 0, true, true});
  }
  if (r.own) j["drift"] = check_drift(r, checks);
  if (ticked) j["tick"] = to_json(tick);
  if (evented) j["event"] = to_json(event);
  j["minutes"] = minutes(r);
  j["histograms"] = histograms(r.all);
  return j;
}

std::string verdict_of(const std::vector<SoakCheck>& checks) {
  bool known = true, kept = true;
  for (const SoakCheck& c : checks) {
    known = known && c.known;
    kept = kept && (!c.known || c.kept());
  }
  return !kept ? "fail" : known ? "pass" : "incomplete";
}

void print_soak(const Json& j, const std::vector<SoakCheck>& checks) {
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
  for (const SoakCheck& c : checks)
    table.emplace_back((c.kept() ? "ok    " : c.known ? "FAIL  " : "none  ") + c.what, judged(c));
  print(table);
}

}  // namespace hapticd
