#include "tools/soak/soak_slice.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "server/os/realtime.h"

namespace hapticd {
namespace {

Tally difference(const nlohmann::json& after, const nlohmann::json& before, const char* key) {
  return tally_from(after.at(key)).since(tally_from(before.at(key)));
}

ServerFigures between(const nlohmann::json& before, const nlohmann::json& after) {
  ServerFigures f;
  f.wake_us = difference(after, before, "wake_histogram");
  f.timer_us = difference(after, before, "timer_histogram");
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
  f.late_states = count("late_states");
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

}  // namespace

void ServerFigures::merge(const ServerFigures& o) {
  wake_us.merge(o.wake_us);
  timer_us.merge(o.timer_us);
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
  late_states += o.late_states;
  steps += o.steps;
  force_peak = std::max(force_peak, o.force_peak);
  seconds += o.seconds;
}

nlohmann::ordered_json to_json(const ServerFigures& f) {
  nlohmann::ordered_json j;
  j["seconds"] = rounded(f.seconds, 2);
  j["slots"] = {{"scheduled", f.scheduled}, {"sent", f.sent}, {"answered", f.answered}};
  j["wake_us"] = to_json(f.wake_us);
  j["timer_us"] = to_json(f.timer_us);
  j["compute_us"] = to_json(f.solve_us);
  j["dds_write_us"] = to_json(f.write_us);
  j["state_age_us"] = to_json(f.state_age_us);
  j["problem_age_ms"] = to_json(f.problem_age_ms);
  j["rtt_us"] = to_json(f.rtt_us);
  j["rtt_less_compute_us"] = to_json(f.rtt_less_compute_us);
  j["late_states"] = f.late_states;
  j["deadline_misses"] = f.misses;
  j["longest_gap_ms"] = rounded(1e-3 * f.interval_us.max(), 3);
  j["sim_rate_hz"] = f.seconds > 0 ? rounded(static_cast<double>(f.steps) / f.seconds, 2) : 0;
  j["force_peak_n"] = f.force_peak;
  return j;
}

ServerFigures client_slice(const ClientSettings& settings, int core, SoakDaemon* server, SwingSource& source,
                           double seconds) {
  SessionOptions options;
  options.client = settings;
  if (server) {
    options.client.domain = server->domain();
    server->go_on();
  }
  const auto slots = static_cast<std::int64_t>(1e3 * seconds);
  const std::int64_t margin = 200;  // slots before the end at which the figures are asked for
  ServerFigures figures;
  {
    const ScopedCore here(core);  // and every thread that the session makes
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

}  // namespace hapticd
