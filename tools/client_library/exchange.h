// One device on its daemon: a state out, its force back, within the device's limits.
//
//   every slot (1 ms):  next_slot → exchange: send, await the answer until 0.1 ms before the slot ends
//
// The C library (haptic_client.h) and the C++ driver (tools/driver) are thin layers over this. It stamps and
// numbers the states (rising over a restart too), arms (force_watch.h), finds its phase against the daemon's
// tick (phase.h), and keeps to the daemon that was heard first (server/dds/force_reader.h). Its end disarms
// the device and disposes of its state. Several in one process share a DDS domain. Threads: one at a time;
// `place` any. Guarantee: exchange and next_slot are noexcept and allocate nothing of their own. Errors: the
// constructor throws std::invalid_argument (no device named), InputError (its file, keys) and
// std::runtime_error (DDS).
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "server/dds/force_reader.h"
#include "server/dds/network.h"
#include "tools/client_library/force_watch.h"
#include "tools/client_library/phase.h"

namespace hapticd {

inline constexpr int client_priority = 50;  // below the daemon's loop (80) and Cyclone's threads (70, 60)

struct ExchangeSettings {
  std::string device;  // a name of config/devices or a file
  std::uint32_t domain = 0, device_id = 0;
  std::filesystem::path keys;  // empty: none
  bool open_network = false;
  std::string station = {};  // the daemon's --station; empty: the one without a name
};

std::int64_t client_now_ns() noexcept;  // CLOCK_MONOTONIC

// Whom the client hears.
enum class Hearing : std::uint8_t { daemon, connecting, nobody, silence, second_daemon, other_client };

struct ExchangeCounts {
  std::uint64_t sent = 0, answered = 0;  // states
  std::uint64_t silences = 0, strange_forces = 0;
  double longest_silence_ms = 0;
};

class Exchange {
 public:
  explicit Exchange(const ExchangeSettings& settings);
  ~Exchange();
  Exchange(const Exchange&) = delete;
  Exchange& operator=(const Exchange&) = delete;

  // Sleeps until the next slot of the grid; one that is late by less than one is sent at once.
  void next_slot() noexcept;

  // felt(Feel) is called for what the device may feel, once at least. An answer to the state before may come
  // first; it is felt too. What it throws is passed on.
  template <typename F>
  Feel exchange(const Reading& reading, F&& felt) {
    const std::int64_t until_ns = send(reading);
    Feel newest;
    bool any = false;
    for (;;) {
      if (take()) {
        felt(newest = feel());
        any = true;
      }
      if (watch_.answered() == state_.number || !await(until_ns)) break;
    }
    if (!any) felt(newest = feel());
    return newest;
  }

  // The device goes to zero at once, and from there on within its slew limit.
  void zero() noexcept { watch_.zero(); }

  Hearing hearing() const noexcept;
  bool is_answered() const noexcept { return watch_.answered() == state_.number; }  // the newest state
  std::uint64_t number() const noexcept { return state_.number; }                   // of it
  ExchangeCounts counts() const noexcept;
  const std::string& place() const noexcept { return place_; }  // DDS domain and profile

 private:
  Exchange(const ExchangeSettings& settings, const StationHere& here);  // the place of all that it makes
  std::int64_t send(const Reading& reading) noexcept;
  void send() noexcept;
  bool await(std::int64_t until_ns) noexcept;
  bool take() noexcept;
  Feel feel() noexcept;

  const DeviceSettings limits_;
  std::shared_ptr<Domain> domain_;
  Participant participant_;
  Writer<hapticd_msg_DeviceState> states_;
  ForceReader forces_;
  DdsEntity arrival_;
  std::string place_;
  ForceWatch watch_;
  Arming arming_;
  PhaseLock phase_;
  hapticd_msg_DeviceState state_{};
  std::int64_t next_ns_ = 0;   // the grid's next point; 0: none yet
  std::int64_t begun_ns_ = 0;  // the first state was sent
  std::int64_t other_ns_ = 0;  // the daemon answered another client
  std::uint64_t sent_ = 0, answered_ = 0;
};

}  // namespace hapticd
