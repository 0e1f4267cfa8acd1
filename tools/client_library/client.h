// A client's handle: one Exchange, whose thread it is, and the library's own 1 kHz thread with its two
// mailboxes.
//
//   enter → swap → leave     by one thread at a time; another is refused until the first has stayed away for
//   0.1 s run                      the own thread: enters once, swaps every slot, ends at zero poses, news
//   newest value (haptic/channel.h): callers take turns, who exchanges never waits
//
// Errors: the constructor throws as Exchange's does; what a callback throws ends the thread
// (HAPTIC_CALLBACK).
#pragma once

#include <sys/types.h>

#include <atomic>
#include <mutex>
#include <optional>
#include <thread>

#include "haptic/channel.h"
#include "tools/client_library/exchange.h"
#include "tools/client_library/haptic_client.h"

namespace hapticd {

// Of haptic_set_pose, of a callback; none: not finite, or no unit quaternion.
std::optional<Reading> reading_of(const haptic_pose& pose) noexcept;

struct Newest {
  haptic_force force = HAPTIC_FORCE_INIT;
  haptic_state state = HAPTIC_STATE_INIT;
};

struct TimedPose {
  haptic_pose pose = HAPTIC_POSE_INIT;
  std::int64_t set_ns = 0;
};

}  // namespace hapticd

struct haptic_client {
  explicit haptic_client(const haptic_options& options);

  // For the thread that exchanges, until `leave`.
  bool enter() noexcept;
  void leave() noexcept;
  haptic_force swap(const haptic_pose& pose, const haptic_callbacks* callbacks);

  haptic_result start(const haptic_callbacks* callbacks);
  haptic_result stop() noexcept;
  haptic_result set_pose(const haptic_pose& pose);

  hapticd::Exchange exchange;
  std::mutex getters;  // of news
  hapticd::Channel<hapticd::Newest> news;

 private:
  haptic_force publish(const hapticd::Feel& feel, haptic_result result) noexcept;
  haptic_force refuse(haptic_result result) noexcept;
  bool owned_by_another(pid_t me) const noexcept;
  bool pose_for(const haptic_callbacks* callbacks, haptic_pose& pose, bool& lost);
  haptic_result loop(const haptic_callbacks* callbacks) noexcept;
  void run(std::optional<haptic_callbacks> callbacks) noexcept;

  const bool ordinary_;  // priority
  std::atomic_flag busy_ = ATOMIC_FLAG_INIT;
  std::atomic<pid_t> owner_{0};  // written while busy
  std::atomic<std::int64_t> owned_ns_{0};

  std::mutex control_;  // of starting and stopping
  std::thread thread_;
  std::atomic<pid_t> thread_id_{0};
  std::atomic<bool> stopping_{false}, inside_{false};
  std::atomic<int> realtime_{0};

  std::mutex setters_;
  hapticd::Channel<hapticd::TimedPose> poses_;
};
