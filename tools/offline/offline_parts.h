// What a scene's run along a motion and the truth it is compared with have in common (offline_run.h): the
// motion, the removals, and what a piece of work costs.
#pragma once

#include <algorithm>
#include <ctime>

#include "physics/contact/suction.h"
#include "tools/offline/offline_run.h"

namespace hapticd::offline {

inline constexpr double tick = 1e-3;     // [s]
inline constexpr double instant = 1e-9;  // times closer than this are the same [s]

inline double cpu_seconds() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// Adds what a piece of work costs this thread.
class Cost {
 public:
  Cost(ThreadCost& of, bool counts) : of_(counts ? &of : nullptr), begun_(cpu_seconds()) {}
  ~Cost() {
    if (!of_) return;
    of_->work.push_back(cpu_seconds() - begun_);
    of_->total += of_->work.back();
  }
  Cost(const Cost&) = delete;
  Cost& operator=(const Cost&) = delete;

 private:
  ThreadCost* of_;
  double begun_;
};

inline InstrumentSample instrument_at(const OfflineInput& input, int i, double t) {
  InstrumentSample sample;
  if (input.motion[i].samples.empty()) return sample;
  sample.pose = sample_at(input.motion[i], input.leads_in ? t : std::max(t, input.from));
  if (input.approach[i] > 0 && t < input.from) {
    constexpr double of_settling = 0.6;
    const double s = std::clamp((t - input.from + input.settle) / (of_settling * input.settle), 0.0, 1.0);
    const double smooth =
        s * s * s * (10 - s * (15 - 6 * s));  // at rest at either end, speed and acceleration
    sample.pose.p.z() += (1 - smooth) * input.approach[i];
  }
  sample.present = true;
  return sample;
}

inline InstrumentSamples instruments_at(const OfflineInput& input, double t) {
  InstrumentSamples samples;
  for (int i = 0; i < max_instruments; ++i) samples[i] = instrument_at(input, i, t);
  return samples;
}

// The pedals that act at t.
inline std::uint32_t pedals_at(const OfflineInput& input, int i, double t) {
  const bool acts = t >= input.from - instant || input.leads_in;
  if (input.pedals == Pedals::idle || !acts || input.motion[i].samples.empty()) return 0;
  const std::uint32_t down = buttons_at(input.motion[i], t);
  return input.pedals == Pedals::all ? down : down & std::uint32_t{pedal_aspiration};
}

// Each port's pump, where no haptic loop has it.
class Pumps {
 public:
  explicit Pumps(const OfflineInput& input) : input_(input) {}

  // A period that ends at t. occlusion: of the last solve.
  void run(double t, double period, Instruments shapes, const EachInstrument<double>& occlusion) {
    for (int i = 0; i < shapes.count(); ++i)
      vacuum_[i] = pumped(shapes[i].port, vacuum_[i], occlusion[i],
                          (pedals_at(input_, i, t) & pedal_aspiration) != 0, period);
  }
  double operator[](int i) const { return vacuum_[i]; }

 private:
  const OfflineInput& input_;
  EachInstrument<double> vacuum_;
};

inline std::size_t compliance_bytes(const StepReport& report) {
  std::size_t bytes = 0;
  for (const BodyReport& b : report.compliance) bytes += b.compliance.memory_bytes;
  return bytes;
}

// Removals as time goes on.
class Removals {
 public:
  explicit Removals(const RemovalSchedule& schedule) : schedule_(schedule) {}

  // Before a step of h that begins at t: what goes until t + lead, and what becomes less until its end.
  void apply(double t, double lead, double h, World& world) {
    for (; next_ < schedule_.size() && schedule_[next_].t <= t + lead + instant; ++next_)
      if (const RemovalEvent& e = schedule_[next_]; e.time == 0) world.schedule_removal(e.body, e.tets);
    for (; thinned_ < schedule_.size() && schedule_[thinned_].t <= t + h + instant; ++thinned_)
      if (const RemovalEvent& e = schedule_[thinned_]; e.time > 0)
        world.schedule_thinning(e.body, e.tets, e.time, t - e.t);
  }

 private:
  const RemovalSchedule& schedule_;
  std::size_t next_ = 0, thinned_ = 0;
};

}  // namespace hapticd::offline
