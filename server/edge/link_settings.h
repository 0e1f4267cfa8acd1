// What both ends of a link between simulation and edge have: whose it is, and how their thread waits.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <thread>
#include <vector>

#include "haptic/device.h"
#include "physics/contact/instruments.h"
#include "server/edge/edge_hands.h"
#include "server/edge/edge_topics.h"

namespace hapticd {

struct LinkSettings {
  std::uint32_t world = 0;  // device id of the world's first instrument
  std::uint64_t scene = 0;  // scene_mark.h
  int instruments = 1;
  EachInstrument<bool> at_simulation =
      {};                       // whose devices are answered beside the simulation, not at the edge
  std::optional<int> keep_off;  // the core of a haptic thread
};

inline constexpr std::int64_t edge_stays_ns = 500'000'000;  // a silent writer keeps its place

// Of a world's devices those that the edge does not answer, whose ids are given.
EachInstrument<bool> others_than(const std::vector<std::uint32_t>& ids,
                                 const std::vector<DeviceSettings>& devices);

// Of a process: another after each start, not 0.
std::uint64_t own_number();

// Until one of two readers has something, or for some time. Throws std::runtime_error where Cyclone refuses.
class LinkWait {
 public:
  LinkWait(const Participant& participant, dds_entity_t reader, dds_entity_t other = 0);
  void until(std::int64_t ns) noexcept;  // CLOCK_MONOTONIC

 private:
  DdsEntity set_, first_, second_;
};

// The thread of an end: at DDS's priority, off the core of the haptic loop. start and stop belong to one
// thread.
class LinkThread {
 public:
  ~LinkThread() { stop(); }
  void start(const LinkSettings& settings, std::function<void()> run);
  void stop() noexcept;
  bool stopping() const noexcept { return stopping_.load(std::memory_order_relaxed); }

 private:
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace hapticd
