#include "tools/client/client.h"

#include <sys/prctl.h>
#include <time.h>

#include <chrono>
#include <cmath>
#include <stdexcept>
#include <thread>
#include <utility>

#include "haptic/clock.h"
#include "server/dds/key_dates.h"
#include "tools/cli/interrupt.h"
#include "tools/client_library/phase.h"

namespace hapticd {
namespace {

constexpr std::int64_t period_ns = 1'000'000;
constexpr std::int64_t silence_ns = 2'000'000'000;
constexpr std::int64_t held_up_ns = 50'000'000;  // half of what disarms a device (watchdog.h)
constexpr int slots_before_enable = 50, slots_between_edges = 1000;
constexpr int rounds_of_phase = 3;
constexpr double phase_tolerance_us = 150;

// What a client can know of it: Cyclone lets go of a participant whose keys end, without a word.
std::string why_silent(const std::optional<Security>& security) {
  if (!security) return "";
  const std::string ended = ended_keys(security);
  return ended.empty() ? " (its log says why; where its keys have ended, that too)" : ": " + ended;
}

}  // namespace

DeviceClient::DeviceClient(const Participant& participant, const ClientSettings& settings, std::int64_t slots)
    : settings_(settings),
      book_(slots),
      answers_(static_cast<std::size_t>(slots)),
      commands_(static_cast<std::size_t>(slots)),
      writer_(participant),
      reader_(participant, settings.device_id, ForceReader::Side::client) {
  const std::unique_ptr<dds_listener_t, decltype(&dds_delete_listener)> listener(dds_create_listener(this),
                                                                                 &dds_delete_listener);
  dds_lset_data_available(listener.get(),
                          [](dds_entity_t, void* self) { static_cast<DeviceClient*>(self)->receive(); });
  require(dds_set_listener(reader_.handle(), listener.get()), "the listener for forces");
}

DeviceClient::~DeviceClient() {
  dds_set_listener(reader_.handle(), nullptr);  // waits for a callback that is under way
}

// Cyclone's receive thread.
void DeviceClient::receive() noexcept {
  std::array<hapticd_msg_ForceCommand, 4> forces;
  std::array<dds_sample_info_t, 4> infos;
  const int n = reader_.take_into(forces, infos);
  const std::int64_t now = monotonic_ns();
  for (std::size_t i = 0; static_cast<int>(i) < n; ++i)
    if (infos[i].valid_data) count(forces[i], now);
}

void DeviceClient::count(const hapticd_msg_ForceCommand& force, std::int64_t now_ns) noexcept {
  const bool is_new = force.echo_number != last_echo_;
  last_echo_ = force.echo_number;
  status_.store(force.status, std::memory_order_relaxed);
  if (force.status & status_gap) gap_.store(true, std::memory_order_relaxed);
  const Vec3 f(force.force[0], force.force[1], force.force[2]);
  newest_force_.store(f.norm(), std::memory_order_relaxed);
  newest_.back() = {f, now_ns};
  newest_.publish();
  heard_ns_.store(now_ns, std::memory_order_relaxed);

  if (counting_.load(std::memory_order_acquire)) {
    const std::int64_t k = book_.slot_of(force.echo_number);
    if (k < 0) {  // of a latched device: the state that it answers may be somebody else's
      status_seen_.fetch_or(force.status & status_latched, std::memory_order_relaxed);
      return;
    }
    status_seen_.fetch_or(force.status, std::memory_order_relaxed);
    if (book_.answer(k, now_ns)) answers_[static_cast<std::size_t>(k)] = force;
  } else if (is_new && force.state_age_us >= 0 &&
             force.echo_number >= ages_since_.load(std::memory_order_acquire)) {
    const std::size_t taken = ages_taken_.load(std::memory_order_relaxed);
    if (taken < age_count) {
      ages_[taken] = force.state_age_us;
      ages_taken_.store(taken + 1, std::memory_order_release);
    }
  }
}

void DeviceClient::send(const DeviceCommand& command, std::uint64_t number, bool enable) noexcept {
  hapticd_msg_DeviceState state{};
  state.device_id = settings_.device_id;
  state.number = number;
  state.client_time_ns = monotonic_ns();
  for (int i = 0; i < 3; ++i) state.position[i] = command.pose.p[i];
  const Quat& q = command.pose.q;
  state.orientation[0] = q.x();
  state.orientation[1] = q.y();
  state.orientation[2] = q.z();
  state.orientation[3] = q.w();
  state.buttons = command.buttons;
  state.enable = enable && settings_.enable;
  writer_.write(state);
}

// Sends the first pose until the daemon renders force in the wanted phase; false: it did not, see stage_.
bool DeviceClient::arm(const DeviceCommand& first) noexcept {
  const std::int64_t begun = monotonic_ns();
  const auto until = begun + static_cast<std::int64_t>(1e9 * settings_.arm_timeout);
  number_ = static_cast<std::uint64_t>(begun / period_ns);
  next_ns_ = begun + period_ns;
  int rounds = 0;
  ages_since_.store(number_ + slots_before_enable, std::memory_order_release);
  for (int slot = 0;; ++slot) {
    // A starved client that was silent for 100 ms is disarmed until the next edge.
    if (slot >= slots_between_edges && (status_.load(std::memory_order_relaxed) & status_disarmed)) slot = 0;
    sleep_until(next_ns_);
    send(first, number_++, slot >= slots_before_enable);
    const std::int64_t now = monotonic_ns();
    // After a late wake-up the grid goes on where it would have been: the phase is kept.
    next_ns_ += period_ns * (1 + std::max<std::int64_t>(0, (now - next_ns_) / period_ns));

    if (ages_taken_.load(std::memory_order_acquire) == age_count && rounds < rounds_of_phase) {
      const double shift = hapticd::phase_shift_us(ages_);
      rounds = std::abs(shift) < phase_tolerance_us ? rounds_of_phase : rounds + 1;
      if (std::abs(shift) >= phase_tolerance_us) {
        phase_shift_us_ += shift;
        next_ns_ += std::llround(1e3 * (shift < 0 ? shift + 1e-3 * period_ns : shift));
      }
      ages_since_.store(~std::uint64_t{0}, std::memory_order_release);
      ages_taken_.store(0, std::memory_order_release);
      ages_since_.store(number_ + 5, std::memory_order_release);
    }
    const std::uint32_t status = status_.load(std::memory_order_relaxed);
    const bool armed =
        !settings_.enable || !(status & (status_disarmed | status_ramping_up | status_latched));
    const bool ready = armed && rounds == rounds_of_phase;
    if (due(ready)) return true;
    if (over()) return false;
    if (now > until && !(ready && arrived_)) {
      stage_.store(heard_ns_.load() == 0 ? Stage::no_answer : Stage::not_armed);
      return false;
    }
  }
}

// Whether slots begin with the next point of the grid.
bool DeviceClient::due(bool ready) noexcept {
  if (!ready || !settings_.start) return ready;
  if (!std::exchange(arrived_, true)) settings_.start->arrive(monotonic_ns());
  const std::int64_t begin = settings_.start->time_ns();
  return begin > 0 && next_ns_ > begin - period_ns / 2;
}

// Slot 0 on the grid: the next point, or the one nearest to the common start, which may be over.
std::int64_t DeviceClient::plan_begin() const noexcept {
  if (!settings_.start) return next_ns_;
  const double late = static_cast<double>(next_ns_ - settings_.start->time_ns()) / period_ns;
  return next_ns_ - std::llround(late) * period_ns;
}

// Whether this slot's state asks for force.
bool DeviceClient::enables(std::int64_t now_ns) noexcept {
  if (!settings_.arm_again) return true;
  if (sent_ns_ > 0 && now_ns - sent_ns_ > held_up_ns) held_up_until_ns_ = now_ns + 4 * held_up_ns;
  sent_ns_ = now_ns;
  if (now_ns < edge_until_ns_ + held_up_ns) return now_ns >= edge_until_ns_;  // until the answer is here
  if (gap_.exchange(false, std::memory_order_relaxed)) held_up_until_ns_ = now_ns + 4 * held_up_ns;
  const std::uint32_t status = status_.load(std::memory_order_relaxed);
  if (now_ns < held_up_until_ns_ && (status & status_disarmed) && !(status & status_latched)) {
    held_up_until_ns_ = 0;
    edge_until_ns_ = now_ns + slots_before_enable * period_ns;
    ++armed_again_;
  }
  return now_ns >= edge_until_ns_;
}

void DeviceClient::serve(SlotSource& source) noexcept {
  book_.begin(plan_begin(), number_);
  counting_.store(true, std::memory_order_release);
  stage_.store(Stage::slots);
  const SlotPlan& plan = book_.plan();
  for (std::int64_t k = 0; k < plan.slots;) {
    sleep_until(plan.time_of(k));
    const std::int64_t now = monotonic_ns();
    k = plan.slot_to_serve(k, now);
    if (k >= plan.slots) break;
    const bool fresh = newest_.acquire();
    DeviceCommand& command = commands_[static_cast<std::size_t>(k)];
    command = source.at(k, now, newest_.front(), fresh);
    book_.send(k, monotonic_ns());
    send(command, plan.number_of(k), enables(now));
    reached_.store(k, std::memory_order_relaxed);
    ++k;
    if (over()) return;
    if (now - heard_ns_.load(std::memory_order_relaxed) > silence_ns) {
      stage_.store(Stage::silent);
      return;
    }
  }
  complete_ = true;
}

void DeviceClient::let_go(const DeviceCommand& last) noexcept {
  const SlotPlan& plan = book_.plan();
  std::int64_t next = std::max(monotonic_ns(), plan.time_of(plan.slots));
  if (!complete_) next = monotonic_ns();
  // Beyond the plan, so that these are nobody's slots.
  std::uint64_t number = std::max(number_, plan.number_of(plan.slots));
  for (int i = 0; i < 25; ++i, next += period_ns) {
    sleep_until(next);
    send(last, number++, i < 20);
  }
  hapticd_msg_DeviceState key{};
  key.device_id = settings_.device_id;
  writer_.dispose(key);
}

void DeviceClient::sender(SlotSource& source) noexcept {
  grant_ = use_fifo(settings_.fifo_priority);
  prctl(PR_SET_TIMERSLACK, 1);
  prefault_stack();
  DeviceCommand last = source.first();
  if (arm(last)) {
    serve(source);
    const std::int64_t k = reached_.load();
    if (k >= 0) last = commands_[static_cast<std::size_t>(k)];
  }
  let_go(last);
  if (const Stage stage = stage_.load(); stage == Stage::arming || stage == Stage::slots)
    stage_.store(Stage::ended);
}

bool DeviceClient::over() const noexcept { return interrupted() || leaving_.load(std::memory_order_relaxed); }

void DeviceClient::wait_for_daemon() {
  const auto until = monotonic_ns() + static_cast<std::int64_t>(1e9 * settings_.match_timeout);
  while (writer_.matched() == 0 || reader_.matched() == 0) {
    if (over()) return;
    if (monotonic_ns() > until)
      throw std::runtime_error("no daemon answered in " +
                               dds_place(settings_.domain, default_dds_profile_name()) + " within " +
                               std::to_string(static_cast<int>(settings_.match_timeout)) +
                               " s: start one with `hapticd SCENE.yaml --domain " +
                               std::to_string(settings_.domain) + "`, or name its domain with --domain");
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

void DeviceClient::check_end() const {
  const std::string id = std::to_string(settings_.device_id);
  switch (stage_.load()) {
    case Stage::no_answer:
      throw std::runtime_error("a daemon is there, but sent no force for device " + id +
                               ": is that the scene's device id? (--device-id)");
    case Stage::not_armed:
      throw std::runtime_error("the daemon did not arm device " + id + ": status " +
                               status_text(status_.load()) +
                               (second_daemon() ? "; a second daemon serves this device" : ""));
    case Stage::silent:
      throw std::runtime_error("the daemon fell silent: no force for 2 s, at slot " +
                               std::to_string(reached_.load()) + " of " + std::to_string(book_.scheduled()) +
                               why_silent(settings_.security));
    default:
      return;
  }
}

void DeviceClient::run(SlotSource& source, const std::function<void(std::int64_t)>& poll) {
  wait_for_daemon();
  std::atomic<bool> over{false};
  std::thread thread([&] {
    sender(source);
    over.store(true);
  });
  const auto end = [&] {
    thread.join();
    dds_set_listener(reader_.handle(), nullptr);
  };
  try {
    while (!over.load()) {
      poll(reached_.load(std::memory_order_relaxed));
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  } catch (...) {
    leave();
    end();
    throw;
  }
  end();
  check_end();
}

std::string status_text(std::uint32_t status) {
  static constexpr const char* names[] = {
      "disarmed",   "holding",    "ramping_down", "ramping_up",       "problem_old",   "problem_lost",
      "gap",        "rejected",   "latched",      "conflict",         "saturated",     "slew_limited",
      "not_finite", "solver_cap", "blending",     "contacts_dropped", "second_daemon", "contact_lost"};
  std::string text;
  for (std::size_t bit = 0; bit < std::size(names); ++bit)
    if (status >> bit & 1) text += (text.empty() ? "" : ", ") + std::string(names[bit]);
  return text.empty() ? "none" : text;
}

}  // namespace hapticd
