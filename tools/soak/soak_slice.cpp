#include "tools/soak/soak_slice.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <thread>

#include "server/os/realtime.h"

namespace hapticd {
namespace {

Tally difference(const nlohmann::json& after, const nlohmann::json& before, const char* key) {
  return tally_from(after.at(key)).since(tally_from(before.at(key)));
}

// Of one device.
ServerFigures between(const nlohmann::json& all_before, const nlohmann::json& all_after,
                      std::uint32_t device) {
  const nlohmann::json &before = device_summary(all_before, device),
                       &after = device_summary(all_after, device);
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
  f.seconds = 1e-9 * static_cast<double>(all_after.at("time_ns").get<std::int64_t>() -
                                         all_before.at("time_ns").get<std::int64_t>());
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

// What the client itself measured.
void add_round_trips(const DeviceClient& client, ServerFigures& f) {
  const SlotBook& book = client.book();
  for (std::int64_t k = 0; k < book.scheduled(); ++k) {
    if (book.answered_ns(k) == 0) continue;
    const double us = 1e-3 * static_cast<double>(book.answered_ns(k) - book.sent_ns(k));
    f.rtt_us.add(std::round(10 * us) / 10);
    f.rtt_less_compute_us.add(std::round(10 * (us - client.answer(k).solve_us)) / 10);
  }
  f.scheduled = book.scheduled();
  f.sent = book.sent();
  f.answered = book.answered();
}

// A hand beside the first one, whose session has domain and thread.
struct FurtherClient {
  Participant participant;
  DeviceClient client;
  std::thread thread = {};

  FurtherClient(const Domain& domain, const ClientSettings& settings, std::int64_t slots)
      : participant(domain), client(participant, settings, slots) {}
};

// All clients of a slice.
class Clients {
 public:
  Clients(SessionOptions options, const std::vector<SoakHand>& hands, std::int64_t slots)
      : hands_(hands), start_(static_cast<int>(hands.size())) {
    // One hand alone begins when it is armed.
    if (hands.size() > 1) options.client.start = &start_;
    session_.emplace(options, slots);
    for (std::size_t i = 1; i < hands.size(); ++i) {
      ClientSettings settings = options.client;
      settings.device_id = hands[i].device_id;
      further_.emplace_back(session_->domain, settings, slots);
    }
  }
  ~Clients() { end(); }

  // poll: as DeviceClient::run's; the slots of all are the same to a period.
  void run(const std::function<void(std::int64_t)>& poll) {
    for (std::size_t i = 0; i < further_.size(); ++i)
      further_[i].thread = std::thread([this, i] { run_further(further_[i], hands_[i + 1].source); });
    session_->client.run(hands_.front().source, [&](std::int64_t reached) {
      if (failed_.load()) session_->client.leave();
      poll(reached);
    });
    for (FurtherClient& f : further_) {
      if (failed_.load()) f.client.leave();
      f.thread.join();
    }
    if (failure_) std::rethrow_exception(failure_);
    for (std::size_t i = 0; i < hands_.size(); ++i)
      if (!client(i).complete()) throw std::runtime_error("interrupted");
  }
  const DeviceClient& client(std::size_t i) const {
    return i == 0 ? session_->client : further_[i - 1].client;
  }

 private:
  void run_further(FurtherClient& of, SwingSource& source) noexcept {
    try {
      of.client.run(source, [](std::int64_t) {});
    } catch (...) {
      const std::lock_guard lock(failing_);
      failure_ = std::current_exception();
      failed_.store(true);
    }
  }
  void end() noexcept {
    for (FurtherClient& f : further_) {
      f.client.leave();
      if (f.thread.joinable()) f.thread.join();
    }
  }

  const std::vector<SoakHand>& hands_;
  CommonStart start_;
  std::optional<Session> session_;
  std::deque<FurtherClient> further_;
  std::mutex failing_;
  std::exception_ptr failure_;
  std::atomic<bool> failed_{false};
};

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

std::vector<ServerFigures> client_slice(const ClientSettings& settings, int core, SoakDaemon* server,
                                        const std::vector<SoakHand>& hands, double seconds) {
  SessionOptions options;
  options.client = settings;
  options.client.device_id = hands.front().device_id;
  if (server) {
    options.client.domain = server->domain();
    server->go_on();
  }
  const auto slots = static_cast<std::int64_t>(1e3 * seconds);
  const std::int64_t margin = 200;  // slots before the end at which the figures are asked for
  std::vector<ServerFigures> figures(hands.size());
  {
    const ScopedCore here(core);  // and every thread that the clients make
    Clients clients(options, hands, slots);
    nlohmann::json before, after;
    clients.run([&](std::int64_t reached) {
      if (!server || reached < 0) return;
      if (before.is_null())
        before = server->summary();
      else if (after.is_null() && reached >= slots - margin)
        after = server->summary();
    });
    if (server && (before.is_null() || after.is_null())) throw std::runtime_error("the slice was too short");
    for (std::size_t i = 0; i < hands.size(); ++i) {
      if (server)
        figures[i] = between(before, after, hands[i].device_id);
      else
        figures[i].seconds = seconds;
      add_answers(clients.client(i), figures[i], server == nullptr);
      add_round_trips(clients.client(i), figures[i]);
    }
  }
  for (const SoakHand& hand : hands) hand.source.rest();
  if (server) server->stop();
  return figures;
}

}  // namespace hapticd
