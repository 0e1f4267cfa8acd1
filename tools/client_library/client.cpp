#include "tools/client_library/client.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>

#include "server/os/realtime.h"

namespace hapticd {

std::optional<Reading> reading_of(const haptic_pose& pose) noexcept {
  Reading reading;
  double norm = 0;
  bool finite = true;
  for (std::size_t i = 0; i < 3; ++i)
    finite = finite && std::isfinite(reading.position[i] = pose.position[i]);
  for (std::size_t i = 0; i < 4; ++i) {
    reading.orientation[i] = pose.orientation[i];
    norm += pose.orientation[i] * pose.orientation[i];
  }
  if (!finite || !(std::abs(norm - 1) < 1e-2)) return std::nullopt;
  reading.buttons = pose.buttons;
  reading.enable = pose.enable != 0;
  return reading;
}

}  // namespace hapticd

using namespace hapticd;

namespace {

constexpr std::int64_t owner_stays_ns = 100'000'000;  // a thread that exchanges no more
constexpr std::int64_t pose_stays_ns = 100'000'000;   // a caller that sets none any more

haptic_result result_of(Hearing hearing) noexcept {
  switch (hearing) {
    case Hearing::daemon:
      return HAPTIC_OK;
    case Hearing::connecting:
      return HAPTIC_CONNECTING;
    case Hearing::nobody:
      return HAPTIC_NO_DAEMON;
    case Hearing::silence:
      return HAPTIC_SILENT;
    case Hearing::second_daemon:
      return HAPTIC_SECOND_DAEMON;
    case Hearing::other_client:
      return HAPTIC_OTHER_CLIENT;
  }
  return HAPTIC_SILENT;
}

}  // namespace

haptic_client::haptic_client(const haptic_options& options)
    : exchange({options.device ? options.device : "", options.domain, options.device_id,
                options.keys ? options.keys : "", (options.flags & HAPTIC_OPEN_NETWORK) != 0,
                options.station ? options.station : ""}),
      ordinary_((options.flags & HAPTIC_ORDINARY_PRIORITY) != 0) {}

// Only the thread that owns the exchange.
haptic_force haptic_client::publish(const Feel& feel, haptic_result result) noexcept {
  haptic_force force = HAPTIC_FORCE_INIT;
  std::copy(feel.force.begin(), feel.force.end(), force.force);
  std::copy(feel.torque.begin(), feel.torque.end(), force.torque);
  force.status = feel.status;
  force.answered = exchange.is_answered();
  force.result = result;
  const ExchangeCounts counts = exchange.counts();
  Newest& newest = news.back();
  newest.force = force;
  newest.state = {sizeof(haptic_state),
                  result,
                  counts.sent,
                  counts.answered,
                  counts.silences,
                  counts.strange_forces,
                  counts.longest_silence_ms,
                  realtime_.load(std::memory_order_relaxed),
                  0};
  news.publish();
  return force;
}

haptic_force haptic_client::refuse(haptic_result result) noexcept {
  exchange.zero();
  return publish({{}, {}, status_disarmed}, result);
}

haptic_force haptic_client::swap(const haptic_pose& pose, const haptic_callbacks* callbacks) {
  const auto write = [callbacks](const haptic_force& force) {
    if (callbacks) callbacks->write(callbacks->user, &force);
  };
  haptic_force newest;
  if (const std::optional<Reading> reading = reading_of(pose)) {
    exchange.exchange(
        *reading, [&](const Feel& feel) { write(newest = publish(feel, result_of(exchange.hearing()))); });
  } else {
    write(newest = refuse(HAPTIC_BAD_POSE));
  }
  return newest;
}

bool haptic_client::owned_by_another(pid_t me) const noexcept {
  const pid_t owner = owner_;
  return owner != 0 && owner != me && client_now_ns() - owned_ns_ < owner_stays_ns;
}

// Another thread is refused before it is busy here, so that the owner never meets it.
bool haptic_client::enter() noexcept {
  const pid_t me = gettid();
  if (owned_by_another(me) || busy_.test_and_set(std::memory_order_acquire)) return false;
  if (owned_by_another(me)) {  // since
    busy_.clear(std::memory_order_release);
    return false;
  }
  owner_ = me;
  return true;
}

void haptic_client::leave() noexcept {
  owned_ns_ = client_now_ns();
  busy_.clear(std::memory_order_release);
}

// The pose of this slot; false: none yet, or the device is lost.
bool haptic_client::pose_for(const haptic_callbacks* callbacks, haptic_pose& pose, bool& lost) {
  if (callbacks) {
    lost = callbacks->read(callbacks->user, &pose) != 0;
    return !lost;
  }
  poses_.acquire();
  const TimedPose& set = poses_.front();
  if (set.set_ns == 0) return false;
  pose = set.pose;
  if (client_now_ns() - set.set_ns > pose_stays_ns) pose.enable = 0;
  return true;
}

haptic_result haptic_client::loop(const haptic_callbacks* callbacks) noexcept try {
  haptic_pose pose = HAPTIC_POSE_INIT;
  for (bool lost = false;;) {
    exchange.next_slot();
    if (stopping_.load(std::memory_order_relaxed)) return HAPTIC_STOPPED;
    if (!pose_for(callbacks, pose, lost)) {
      if (lost) return HAPTIC_STOPPED;
      continue;
    }
    swap(pose, callbacks);
  }
} catch (...) {
  return HAPTIC_CALLBACK;
}

void haptic_client::run(std::optional<haptic_callbacks> callbacks) noexcept {
  thread_id_.store(gettid());
  name_thread("haptic_client");
  if (!ordinary_) {
    try {
      realtime_.store(use_fifo(client_priority).granted ? 1 : -1);
    } catch (...) {  // no memory for its text
      realtime_.store(-1);
    }
  }
  prefault_stack();
  haptic_result end = loop(callbacks ? &*callbacks : nullptr);
  haptic_force zero = refuse(end);
  try {
    if (callbacks) callbacks->write(callbacks->user, &zero);
  } catch (...) {
    publish({{}, {}, status_disarmed}, end = HAPTIC_CALLBACK);
  }
  leave();
  thread_id_.store(0);  // the number may be another thread's from here on
  inside_.store(false);
}

haptic_result haptic_client::stop() noexcept {
  if (thread_id_.load() == gettid()) return HAPTIC_WRONG_THREAD;
  const std::lock_guard lock(control_);
  stopping_.store(true);
  if (thread_.joinable()) thread_.join();
  thread_id_.store(0);
  stopping_.store(false);
  return HAPTIC_OK;
}

haptic_result haptic_client::start(const haptic_callbacks* callbacks) {
  const std::lock_guard lock(control_);
  if (inside_.load() || !enter()) return HAPTIC_WRONG_THREAD;
  if (thread_.joinable()) thread_.join();  // one that ended by itself
  inside_.store(true);
  try {
    std::optional<haptic_callbacks> own;
    if (callbacks) own = *callbacks;
    thread_ = std::thread([this, own] { run(own); });
  } catch (...) {
    inside_.store(false);
    leave();
    throw;
  }
  return HAPTIC_OK;
}

haptic_result haptic_client::set_pose(const haptic_pose& pose) {
  if (!reading_of(pose)) return HAPTIC_BAD_POSE;
  const std::lock_guard lock(setters_);
  poses_.back() = {pose, client_now_ns()};
  poses_.publish();
  return HAPTIC_OK;
}
