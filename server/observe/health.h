// How the daemon is, for people who look at it: ServerHealth, from the diagnostics thread.
//
//   force    blocks of 10 ticks: mean of the force on the device, and its largest norm; the newest second
//   bins     0: [0, 2^10) ns; then four an octave, 2^(10 + q/4) (1 + (q mod 4)/4), up to 2^24 ns (16.8 ms),
//   the last
//            open above: edges of the bins that the loops count in (haptic/histogram.h), so nothing is
//            smeared
//   parts    mean over the steps since the last message
//
// Each message is a state, not a change: one that is lost costs nothing that the next has not. Without a
// reader none is made. Units: N, ms. Thread safety: one thread. Errors: the constructor throws
// std::runtime_error (DDS).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "haptic/histogram.h"
#include "haptic/loop.h"
#include "physics/simulation/world.h"
#include "server/dds/dds.h"
#include "server/scene/scene.h"

namespace hapticd {

inline constexpr int health_octaves = 14, health_bins = 1 + 4 * health_octaves;
inline constexpr std::size_t ticks_per_block = 10, blocks_kept = 100;

std::vector<std::uint32_t> health_counts(const HistogramSnapshot& histogram);
// Upper edge of the bin in which the share q of these counts is reached [ns]; NaN: there are none.
double health_quantile_ns(const std::vector<std::uint32_t>& counts, double q);

// The newest forces, folded.
class ForceBlocks {
 public:
  void note(const Vec3& force);
  std::uint64_t count() const noexcept { return count_; }
  // 4 per block, oldest first.
  std::vector<float> newest() const;

 private:
  std::array<std::array<float, 4>, blocks_kept> block_{};
  std::uint64_t count_ = 0;
  Vec3 sum_ = Vec3::Zero();
  double largest_ = 0;
  std::size_t ticks_ = 0;
};

// What the simulation tells of a step beside its geometry.
struct StepHealth {
  std::uint64_t step = 0;
  std::array<std::int64_t, step_parts> part_ns{};  // summed since the start
  std::vector<BodyReport> bodies;                  // those awake in the newest step
};

class HealthPublisher {
 public:
  // Everything referred to must outlive it. The device is the one of that id.
  HealthPublisher(const Participant& participant, const Scene& scene, std::uint32_t device_id);

  void show(const Scene& scene);  // from here on
  void note(const ForceRecord& record);
  void publish(const HistogramSnapshot& wake, const HistogramSnapshot& solve, const StepHealth& step);
  bool heard() const noexcept { return writer_.matched() > 0; }

 private:
  const Scene* scene_;
  const std::uint32_t device_id_;
  DeviceSettings device_;
  std::string name_;
  ForceBlocks force_;
  double energy_ = 0, energy_least_ = 0;
  StepHealth last_;
  Writer<hapticd_msg_ServerHealth> writer_;
};

}  // namespace hapticd
