#include "tools/soak.h"

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <stdexcept>
#include <thread>

#include "server/input_error.h"
#include "server/paths.h"
#include "server/realtime.h"
#include "server/scene_reader.h"
#include "tools/child.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/load.h"
#include "tools/progress.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double cycle_seconds = 12;
constexpr double tick_share = 2.0 / 6, cyclictest_share = 2.0 / 6, event_share = 1.0 / 6,
                 ddsperf_share = 1.0 / 6;
// Bounds of the verdict: what the machine does to a public tool, times what we may add.
constexpr double wake_p99_limit = 1.2, wake_p99_9_limit = 1.5, rtt_p50_limit = 1.5, answered_limit = 0.999;
constexpr double drift_limit = 1.25, rss_limit_mb = 4, drift_from_minutes = 6;

// The scene's motion, forth and back for ever, without pedals.
class SwingSource final : public SlotSource {
 public:
  explicit SwingSource(const Trajectory& trajectory) : trajectory_(trajectory) {}
  DeviceCommand first() const noexcept override { return pose_at(offset_ms_); }
  DeviceCommand at(std::int64_t k, std::int64_t, const NewestForce&, bool) noexcept override {
    reached_ms_ = offset_ms_ + static_cast<double>(k);
    return pose_at(reached_ms_);
  }
  void rest() noexcept { offset_ms_ = reached_ms_; }  // the next run goes on from here

 private:
  DeviceCommand pose_at(double ms) const noexcept {
    const double length = trajectory_.end() - trajectory_.begin();
    const double t = std::fmod(1e-3 * ms, 2 * length);
    return {sample_at(trajectory_, trajectory_.begin() + (t < length ? t : 2 * length - t)), 0};
  }
  const Trajectory& trajectory_;
  double offset_ms_ = 0, reached_ms_ = 0;
};

std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

// A daemon of this soak's own.
class Server {
 public:
  Server(const std::string& scene, const std::string& mode, std::uint32_t domain, const fs::path& scratch)
      : domain_(domain),
        figures_(scratch / ("hapticd_" + mode + ".json")),
        log_(scratch / ("hapticd_" + mode + ".log")),
        child_({.command = {beside_this_program("hapticd"), scene, "--mode", mode, "--domain",
                            std::to_string(domain), "--json", figures_.string()},
                .output = log_.string()}) {
    for (int i = 0; i < 600 && child_.running() && !ready(); ++i) usleep(100'000);
    if (!ready()) throw std::runtime_error("hapticd did not start: " + text_of(log_));
    stop();
  }
  ~Server() {
    go_on();
    child_.signal(SIGTERM);
    child_.wait(5);
  }
  void stop() { child_.signal(SIGSTOP); }
  void go_on() { child_.signal(SIGCONT); }
  std::uint32_t domain() const { return domain_; }
  std::string log() const { return text_of(log_); }

  // Its summary so far.
  nlohmann::json summary() {
    fs::remove(figures_);
    child_.signal(SIGUSR1);
    for (int i = 0; i < 3000; ++i) {
      if (fs::exists(figures_)) return last_ = nlohmann::json::parse(text_of(figures_));
      if (!child_.running()) break;
      usleep(1000);
    }
    throw std::runtime_error("hapticd gave no figures: " + log());
  }
  const nlohmann::json& last() const { return last_; }
  double resident_mb() const { return last_.at("rss_mb").get<double>(); }

 private:
  bool ready() const { return text_of(log_).find("ready") != std::string::npos; }

  std::uint32_t domain_;
  fs::path figures_, log_;
  Child child_;
  nlohmann::json last_;
};

Tally difference(const nlohmann::json& after, const nlohmann::json& before, const char* key) {
  return tally_from(after.at(key)).since(tally_from(before.at(key)));
}

ServerFigures between(const nlohmann::json& before, const nlohmann::json& after) {
  ServerFigures f;
  f.wake_us = difference(after, before, "wake_histogram");
  f.solve_us = difference(after, before, "solve_histogram");
  f.write_us = difference(after, before, "write_histogram");
  f.interval_us = difference(after, before, "interval_histogram");
  f.state_age_us = difference(after, before, "state_age_histogram");
  const Tally problem_age = difference(after, before, "problem_age_histogram");
  for (const auto& [us, n] : problem_age.bins()) f.problem_age_ms.add(1e-3 * us, n);
  const auto count = [&](const char* key) {
    return after.at(key).get<std::int64_t>() - before.at(key).get<std::int64_t>();
  };
  f.misses = count("haptic_deadline_misses");
  f.steps = count("sim_steps");
  f.seconds = 1e-9 * static_cast<double>(count("time_ns"));
  return f;
}

// What the answers alone say, for a daemon that is not ours.
void add_answers(const DeviceClient& client, ServerFigures& f, bool all) {
  std::int64_t before = 0;
  for (std::int64_t k = 0; k < client.book().scheduled(); ++k) {
    const std::int64_t arrived = client.book().answered_ns(k);
    if (arrived == 0) continue;
    const hapticd_msg_ForceCommand& m = client.answer(k);
    f.force_peak = std::max(f.force_peak, std::hypot(m.force[0], m.force[1], m.force[2]));
    if (!all) continue;
    f.wake_us.add(std::round(10 * m.wake_us) / 10);
    f.solve_us.add(std::round(10 * m.solve_us) / 10);
    f.state_age_us.add(std::round(10 * m.state_age_us) / 10);
    f.problem_age_ms.add(std::round(100 * m.problem_age_ms) / 100);
    if (before > 0) f.interval_us.add(std::round(1e-3 * static_cast<double>(arrived - before)));
    before = arrived;
  }
}

// A client on the daemon for `seconds`. server: ours, or null.
ServerFigures client_slice(const ClientSettings& settings, Server* server, SwingSource& source,
                           double seconds) {
  SessionOptions options;
  options.client = settings;
  if (server) {
    options.client.domain = server->domain();
    server->go_on();
  }
  const auto slots = static_cast<std::int64_t>(1e3 * seconds);
  const std::int64_t margin = 100;  // slots before the end at which the figures are asked for
  ServerFigures figures;
  {
    Session session(options, slots);
    nlohmann::json before, after;
    session.client.run(source, [&](std::int64_t reached) {
      if (!server || reached < 0) return;
      if (before.is_null())
        before = server->summary();
      else if (after.is_null() && reached >= slots - margin)
        after = server->summary();
    });
    if (!session.client.complete()) throw std::runtime_error("interrupted");
    if (server && (before.is_null() || after.is_null())) throw std::runtime_error("the slice was too short");
    if (server)
      figures = between(before, after);
    else
      figures.seconds = seconds;
    add_answers(session.client, figures, server == nullptr);
    const SlotBook& book = session.client.book();
    for (std::int64_t k = 0; k < slots; ++k) {
      if (book.answered_ns(k) == 0) continue;
      const double us = 1e-3 * static_cast<double>(book.answered_ns(k) - book.sent_ns(k));
      figures.rtt_us.add(std::round(10 * us) / 10);
      figures.rtt_less_compute_us.add(std::round(10 * (us - session.client.answer(k).solve_us)) / 10);
    }
    figures.scheduled = book.scheduled();
    figures.sent = book.sent();
    figures.answered = book.answered();
  }
  source.rest();
  if (server) server->stop();
  return figures;
}

Json to_json(const ServerFigures& f) {
  Json j;
  j["seconds"] = rounded(f.seconds, 2);
  j["slots"] = {{"scheduled", f.scheduled}, {"sent", f.sent}, {"answered", f.answered}};
  j["wake_us"] = to_json(f.wake_us);
  j["compute_us"] = to_json(f.solve_us);
  j["dds_write_us"] = to_json(f.write_us);
  j["state_age_us"] = to_json(f.state_age_us);
  j["problem_age_ms"] = to_json(f.problem_age_ms);
  j["rtt_us"] = to_json(f.rtt_us);
  j["rtt_less_compute_us"] = to_json(f.rtt_less_compute_us);
  j["deadline_misses"] = f.misses;
  j["longest_gap_ms"] = rounded(1e-3 * f.interval_us.max(), 3);
  j["sim_rate_hz"] = f.seconds > 0 ? rounded(static_cast<double>(f.steps) / f.seconds, 2) : 0;
  j["force_peak_n"] = f.force_peak;
  return j;
}

Json histograms(const SoakFigures& f) {
  Json j;
  j["wake_us"] = to_bins(f.tick.wake_us);
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

// One soak from start to end.
class Soak {
 public:
  Soak(const SoakOptions& options, const Scene& scene, const fs::path& scratch)
      : options_(options),
        scratch_(scratch),
        load_(options.load / 100),
        source_(*trajectory_of(scene)),
        core_(std::max(1, static_cast<int>(std::thread::hardware_concurrency())) - 1) {
    has_cyclictest_ = is_installed("cyclictest");
    has_ddsperf_ = is_installed("ddsperf");
    tool_domain_ = options.client.domain + 2;
    if (options.attach) return;
    const std::uint32_t d = options.client.domain;
    if (options.mode != "event") tick_ = std::make_unique<Server>(scene.file.string(), "tick", d, scratch);
    if (options.mode != "tick")
      event_ = std::make_unique<Server>(scene.file.string(), "event", d + 1, scratch);
  }

  void run() {
    const int cycles = std::max(1, static_cast<int>(std::lround(options_.duration / cycle_seconds)));
    const double seconds = options_.duration / cycles;
    const CpuTimes before = cpu_times();
    Progress progress("soak");
    for (int c = 0; c < cycles && !interrupted(); ++c) {
      SoakFigures part =
          cycle(seconds, [&](const char* what, double done) { progress.show((c + done) / cycles, what); });
      if (first_rss_ == 0) first_rss_ = part.rss_mb;
      all_.merge(part);
      const double minute = std::floor((c + 0.5) * seconds / 60);
      if (minute != minute_ || minutes_.empty()) minutes_.emplace_back();
      minute_ = minute;
      minutes_.back().merge(part);
    }
    if (interrupted()) throw std::runtime_error("interrupted");
    const CpuTimes after = cpu_times();
    const double total = after.busy + after.idle + after.steal - before.busy - before.idle - before.steal;
    busy_ = (after.busy - before.busy) / total;
    steal_ = (after.steal - before.steal) / total;
  }

  Json report(std::vector<SoakCheck>& checks) const;

  const SoakFigures& figures() const { return all_; }

 private:
  const Trajectory* trajectory_of(const Scene& scene) {
    trajectory_ = read_trajectory(*scene.trajectory, LengthUnit::metre);
    return &trajectory_;
  }

  template <typename Show>
  SoakFigures cycle(double seconds, Show&& show) {
    SoakFigures f;
    const bool attached_event = options_.attach && options_.mode == "event";
    if (tick_ || (options_.attach && !attached_event)) {
      show("tick", 0);
      f.tick = client_slice(options_.client, tick_.get(), source_, tick_share * seconds);
    }
    if (has_cyclictest_) {
      show("cyclictest", 0.33);
      f.cyclictest_us = with_hidden_wakeups(
          run_cyclictest(cyclictest_share * seconds, core_, haptic_priority, scratch_.string()));
    }
    if (event_ || attached_event) {
      show("event", 0.67);
      f.event = client_slice(options_.client, event_.get(), source_, event_share * seconds);
    }
    if (has_ddsperf_ && !interrupted()) {
      show("ddsperf", 0.83);
      f.ddsperf =
          run_ddsperf(ddsperf_share * seconds, core_, static_cast<int>(tool_domain_), scratch_.string());
    }
    for (const Server* server : {tick_.get(), event_.get()})
      if (server) f.rss_mb += server->resident_mb();
    return f;
  }

  Json minutes() const;

  SoakOptions options_;
  fs::path scratch_;
  Load load_;  // before anything makes threads
  Trajectory trajectory_;
  SwingSource source_;
  int core_;
  std::uint32_t tool_domain_ = 0;
  bool has_cyclictest_ = false, has_ddsperf_ = false;
  std::unique_ptr<Server> tick_, event_;
  SoakFigures all_;
  std::vector<SoakFigures> minutes_;
  double minute_ = -1, first_rss_ = 0, busy_ = 0, steal_ = 0;
};

Json Soak::minutes() const {
  Json list = Json::array();
  for (const SoakFigures& m : minutes_)
    list.push_back({{"wake_us", to_json(m.tick.wake_us)},
                    {"cyclictest_us", to_json(m.cyclictest_us)},
                    {"state_age_us", to_json(m.tick.state_age_us)},
                    {"rtt_us", to_json(m.event.rtt_us)},
                    {"ddsperf_p50_us", rounded(m.ddsperf.p50(), 2)},
                    {"rss_mb", rounded(m.rss_mb, 2)}});
  return list;
}

Json Soak::report(std::vector<SoakCheck>& checks) const {
  const ServerFigures& tick = all_.tick;
  const ServerFigures& event = all_.event;
  const bool ticked = tick.scheduled > 0, evented = event.scheduled > 0;
  ServerFigures both = tick;
  both.merge(event);
  Json j;
  j["command"] = "soak";
  j["scene"] = options_.scene;
  j["mode"] = options_.attach ? "attached" : options_.mode;
  j["duration_s"] = options_.duration;
  j["load_percent"] = options_.load;
  j["cpu_busy_percent"] = rounded(100 * busy_, 1);
  j["steal_percent"] = rounded(100 * steal_, 3);
  j["slots"] = {{"scheduled", both.scheduled}, {"sent", both.sent}, {"answered", both.answered}};
  // Of the fixed tick where there is one; the round trip of the events where there are.
  const ServerFigures& main = ticked ? tick : event;
  j["wake_us"] = to_json(main.wake_us);
  j["cyclictest_us"] = to_json(all_.cyclictest_us);
  j["compute_us"] = to_json(main.solve_us);
  j["dds_write_us"] = to_json(main.write_us);
  j["rtt_us"] = to_json(evented ? event.rtt_us : tick.rtt_us);
  // What is left when the contact solve of each answer is taken away: the way, both directions.
  j["rtt_less_compute_us"] = to_json(evented ? event.rtt_less_compute_us : tick.rtt_less_compute_us);
  const bool pinged = all_.ddsperf.count > 0;
  const auto or_null = [](bool known, double v, int digits = 2) {
    return known ? Json(rounded(v, digits)) : Json();
  };
  j["ddsperf_us"] = {{"p50", or_null(pinged, all_.ddsperf.p50())},
                     {"p99", or_null(pinged, all_.ddsperf.p99())},
                     {"max", or_null(pinged, all_.ddsperf.max)},
                     {"count", all_.ddsperf.count}};
  const bool woken = ticked && all_.cyclictest_us.count() > 0;
  const auto over = [](double a, double b) { return b > 0 ? a / b : 0; };
  const double wake_p99 = over(tick.wake_us.percentile(99), all_.cyclictest_us.percentile(99));
  const double wake_p99_9 = over(tick.wake_us.percentile(99.9), all_.cyclictest_us.percentile(99.9));
  const double rtt_p50 = over(event.rtt_us.percentile(50), all_.ddsperf.p50());
  j["ratio"] = {
      {"wake_p99", or_null(woken, wake_p99, 3)},
      {"wake_p99_9", or_null(woken, wake_p99_9, 3)},
      {"rtt_p50", or_null(evented && pinged, rtt_p50, 3)},
      {"rtt_less_compute_p50",
       or_null(evented && pinged, over(event.rtt_less_compute_us.percentile(50), all_.ddsperf.p50()), 3)}};
  j["state_age_us"] = to_json(main.state_age_us);
  j["problem_age_ms"] = to_json(main.problem_age_ms);
  j["sim_rate_hz"] = to_json(main)["sim_rate_hz"];
  j["deadline_misses"] = both.misses;
  j["longest_gap_ms"] = rounded(1e-3 * both.interval_us.max(), 3);
  j["force_peak_n"] = both.force_peak;

  std::int64_t allocations = 0, port = 0, faults = 0;
  bool counted = !options_.attach;
  Json refused = Json::array();
  for (const auto* server : {tick_.get(), event_.get()}) {
    if (!server) continue;
    const nlohmann::json& s = server->last();
    counted = counted && s.contains("allocations_in_haptic_code");
    allocations += s.value("allocations_in_haptic_code", std::int64_t{0});
    port += s.value("allocations_in_device_port", std::int64_t{0});
    faults += s.value("page_faults", std::int64_t{0});
    for (const auto& grant : s.at("grants"))
      if (!grant.at("granted").get<bool>()) refused.push_back(grant.at("what").get<std::string>());
  }
  const bool own = !options_.attach;
  j["allocations_in_haptic_code"] = counted ? Json(allocations) : Json();
  j["allocations_in_device_port"] = counted ? Json(port) : Json();
  j["page_faults"] = own ? Json(faults) : Json();
  j["refused"] = refused;
  j["rss_mb"] = {{"start", rounded(first_rss_, 2)}, {"end", rounded(minutes_.back().rss_mb, 2)}};

  checks.push_back({"wake p99 / cyclictest", wake_p99, wake_p99_limit, true, woken || !ticked});
  checks.push_back({"wake p99.9 / cyclictest", wake_p99_9, wake_p99_9_limit, true, woken || !ticked});
  if (evented) checks.push_back({"event round trip p50 / ddsperf", rtt_p50, rtt_p50_limit, true, pinged});
  checks.push_back(
      {"answered / scheduled", share(both.answered, both.scheduled), answered_limit, false, true});
  if (ticked)
    checks.push_back({"state age p99, tick [µs]", tick.state_age_us.percentile(99),
                      1000 + 2 * all_.cyclictest_us.percentile(99), true, woken});
  if (own) {
    checks.push_back({"allocations in haptic code", static_cast<double>(allocations), 0, true, counted});
    checks.push_back({"page faults after arming", static_cast<double>(faults), 0, true, true});
  }
  if (static_cast<double>(minutes_.size()) >= drift_from_minutes) {
    std::vector<double> wake[2], rtt[2];
    const std::size_t third = minutes_.size() / 3;
    for (std::size_t i = 0; i < minutes_.size(); ++i) {
      if (i >= third && i < minutes_.size() - third) continue;
      const int side = i < third ? 0 : 1;
      wake[side].push_back(minutes_[i].tick.wake_us.percentile(50));
      rtt[side].push_back(minutes_[i].event.rtt_us.percentile(50));
    }
    const double wake_drift = drift(wake[0], wake[1]), rtt_drift = drift(rtt[0], rtt[1]);
    j["drift"] = {{"wake_p50", rounded(wake_drift, 3)}, {"rtt_p50", rounded(rtt_drift, 3)}};
    if (ticked) checks.push_back({"wake p50, last third / first", wake_drift, drift_limit, true, true});
    if (evented) checks.push_back({"round trip p50, last third / first", rtt_drift, drift_limit, true, true});
    if (own)
      checks.push_back(
          {"memory, end − start [MB]", minutes_.back().rss_mb - first_rss_, rss_limit_mb, true, true});
  }
  if (ticked) j["tick"] = to_json(tick);
  if (evented) j["event"] = to_json(event);
  j["minutes"] = minutes();
  j["histograms"] = histograms(all_);
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
  table.emplace_back("deadline misses, longest gap",
                     j.at("deadline_misses").dump() + ", " + j.at("longest_gap_ms").dump() + " ms");
  table.emplace_back("simulation", j.at("sim_rate_hz").dump() + " Hz");
  table.emplace_back("processors busy, stolen",
                     j.at("cpu_busy_percent").dump() + " %, " + j.at("steal_percent").dump() + " %");
  table.emplace_back("memory",
                     j.at("rss_mb").at("start").dump() + " → " + j.at("rss_mb").at("end").dump() + " MB");
  for (const SoakCheck& c : checks)
    table.emplace_back(
        (c.kept()  ? "ok    "
         : c.known ? "FAIL  "
                   : "none  ") +
            c.what,
        c.known ? fixed(c.value, 3) + (c.at_most ? " ≤ " : " ≥ ") + fixed(c.limit, 3) : "not measured");
  print(table);
}

}  // namespace

void ServerFigures::merge(const ServerFigures& o) {
  wake_us.merge(o.wake_us);
  solve_us.merge(o.solve_us);
  write_us.merge(o.write_us);
  interval_us.merge(o.interval_us);
  state_age_us.merge(o.state_age_us);
  problem_age_ms.merge(o.problem_age_ms);
  rtt_us.merge(o.rtt_us);
  rtt_less_compute_us.merge(o.rtt_less_compute_us);
  scheduled += o.scheduled;
  sent += o.sent;
  answered += o.answered;
  misses += o.misses;
  steps += o.steps;
  force_peak = std::max(force_peak, o.force_peak);
  seconds += o.seconds;
}

void SoakFigures::merge(const SoakFigures& o) {
  tick.merge(o.tick);
  event.merge(o.event);
  cyclictest_us.merge(o.cyclictest_us);
  ddsperf.merge(o.ddsperf);
  rss_mb = o.rss_mb;
}

double drift(const std::vector<double>& first, const std::vector<double>& last) {
  if (first.empty() || last.empty()) return 1;
  const double a = quantiles(first).p50, b = quantiles(last).p50;
  return a > 0 && b > 0 ? std::max(a / b, b / a) : 1;
}

int soak(SoakOptions options) {
  if (options.scene.empty()) options.scene = (config_directory() / "scenes/cube/cube.yaml").string();
  const Scene scene = read_scene(options.scene);
  if (!scene.trajectory) throw UsageError(options.scene + ": has no trajectory to move along");
  options.client.device_id = options.attach ? options.client.device_id : scene.device.id;
  const fs::path scratch = fs::temp_directory_path() / ("haptic-soak-" + std::to_string(getpid()));
  fs::create_directories(scratch);
  const std::unique_ptr<const fs::path, void (*)(const fs::path*)> gone(&scratch, [](const fs::path* p) {
    std::error_code e;
    fs::remove_all(*p, e);
  });
  if (!options.out.empty()) fs::create_directories(options.out);

  for (const char* tool : {"cyclictest", "ddsperf"})
    if (!is_installed(tool))
      std::fprintf(stderr, "haptic: %s is not installed (tools/setup): no ratio against it\n", tool);
  Soak run(options, scene, scratch);
  run.run();

  std::vector<SoakCheck> checks;
  Json json = run.report(checks);
  const std::string verdict = verdict_of(checks);
  Json list = Json::array();
  for (const SoakCheck& c : checks)
    list.push_back({{"what", c.what},
                    {"value", c.known ? Json(rounded(c.value, 4)) : Json()},
                    {"limit", rounded(c.limit, 4)},
                    {"kept", c.kept()}});
  json["checks"] = list;
  json["verdict"] = verdict;
  if (!options.json.empty()) write_json(options.json, json);
  print_soak(json, checks);
  if (!options.out.empty()) {
    const std::string file = (fs::path(options.out) / "soak.json").string();
    write_json(file, json);
    Child plot({.command = {"/usr/bin/python3", (config_directory() / "../tools/plot_soak.py").string(), file,
                            (fs::path(options.out) / "soak.png").string()},
                .output = (scratch / "plot.txt").string()});
    if (plot.wait(60) != 0)
      throw std::runtime_error("the histograms could not be drawn: " + text_of(scratch / "plot.txt"));
  }
  std::printf("verdict: %s\n", verdict.c_str());
  return verdict == "pass" ? 0 : 1;
}

Command add_soak(CLI::App& application) {
  auto options = std::make_shared<SoakOptions>();
  CLI::App* app = application.add_subcommand(
      "soak",
      "Runs daemon and client for long and compares them with cyclictest and ddsperf in the same minutes.");
  app->add_option("--duration", options->duration, "of all slices together [s]")
      ->check(CLI::Range(6.0, 86400.0))
      ->capture_default_str();
  app->add_option("--load", options->load, "keep every core busy for this share of the time [%]")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  app->add_option("--scene", options->scene, "default: the cube")->type_name("SCENE.yaml");
  app->add_option("--mode", options->mode, "of the daemon; both: one of each, in turns")
      ->check(CLI::IsMember({"both", "tick", "event"}))
      ->capture_default_str();
  app->add_option("--json", options->json, "write the figures to this file")->type_name("FILE");
  app->add_option("--out", options->out, "write soak.json and the histograms, soak.png, here")
      ->type_name("DIR");
  app->add_flag("--attach", options->attach,
                "soak the daemon that runs in --domain; --mode event says that it is in that mode");
  app->add_option("--domain", options->client.domain, "DDS domain; this one and the next two are used")
      ->check(CLI::Range(0u, 228u))
      ->capture_default_str();
  app->add_option("--device-id", options->client.device_id, "with --attach: the device to be")
      ->capture_default_str();
  app->footer(
      "Example: haptic soak --duration 60 --load 70 --json soak.json --out build/soak\n"
      "Exit code 0 only if every bound in the table was kept.");
  return {app, [options] { return soak(*options); }};
}

}  // namespace hapticd
