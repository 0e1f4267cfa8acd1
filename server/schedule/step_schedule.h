// What the simulation does next, and when: one object without thread or clock.
//
//   t_k = t_0 + k h:  begin (adopt the reference factors that are ready; removals, at the newest pose)
//                     → publish_interim, where something went → factor → finish (at the newest pose)
//                     → publish, and ask for the reference factors that are wanted
//   t_k + 0.6 h, 0.8 h, after a step that removed something:  refresh → publish_refresh
//
// A refresh whose time has passed is left out. A step that ends more than h after t_{k+1} leaves the passed
// grid points out. The live thread (simulation_loop.h) performs actions when the machine's clock says so, a
// virtual daemon (virtual_daemon.h) in virtual time, a recorded schedule (schedule_replay.h) as they were.
// Units: ns. Thread safety: one thread. Errors: what World throws.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "haptic/haptic_step.h"
#include "physics/simulation/world.h"

namespace hapticd {

enum class StepAction : std::uint8_t {
  begin,
  publish_interim,
  factor,
  finish,
  publish,
  refresh,
  publish_refresh
};

// What the haptic side tells, as the simulation takes it.
inline InstrumentSample sample_of(const InstrumentInput& i) noexcept {
  return {i.X, i.present, (i.buttons & pedal_phaco) != 0, (i.buttons & pedal_aspiration) != 0,
          1e-9 * static_cast<double>(i.received_ns), i.vacuum};
}

inline InstrumentSamples samples_of(const InstrumentInputs& inputs) noexcept {
  InstrumentSamples samples;
  for (int i = 0; i < max_instruments; ++i) samples[i] = sample_of(inputs[i]);
  return samples;
}

// What a step needs of whoever drives it.
class StepHost {
 public:
  virtual ~StepHost() = default;
  // The newest that is known.
  virtual InstrumentSamples latch() = 0;
  // The problem to be written next, and its publication: the haptic side takes it from now on.
  virtual CondensedProblem& problem() = 0;
  virtual void publish(StepAction as) = 0;
  // Reference factors: one that is ready, and one to be made meanwhile.
  virtual std::optional<ReferenceJob> finished_reference() = 0;
  virtual void make_reference(ReferenceJob job) = 0;
};

struct PlannedAction {
  StepAction action = StepAction::begin;
  std::int64_t due_ns = 0;   // not before; what is within a step is due at once
  std::int64_t step_ns = 0;  // the grid point of its step
  std::int64_t skipped = 0;  // grid points that this action leaves out
  std::int64_t asked_ns = 0;
};

struct StepScheduleOptions {
  bool interims = true;
  std::vector<double> refresh_at = {0.6, 0.8};  // periods after a step's grid point
};

class StepSchedule {
 public:
  // first_ns: t_0. The world must outlive the schedule.
  StepSchedule(World& world, std::int64_t period_ns, const StepScheduleOptions& options = {});

  // The first step pays for cold caches and the symbolic factor, and has no instrument: before `start`, on no
  // grid. Its problem is not published.
  void warm_up(CondensedProblem& unpublished);
  void start(std::int64_t first_ns) noexcept { step_ns_ = first_ns; }

  // As of `now`. Asking changes nothing.
  PlannedAction next(std::int64_t now_ns) const noexcept;
  // `planned` is what `next` said last.
  void perform(const PlannedAction& planned, StepHost& host);

  StepBegin begun() const noexcept { return begun_; }            // of the step under way, or the last
  const StepReport& report() const noexcept { return report_; }  // of the last step that was finished
  std::int64_t period_ns() const noexcept { return period_ns_; }

 private:
  PlannedAction next_begin(std::int64_t now_ns) const noexcept;
  std::int64_t refresh_ns(std::size_t i) const noexcept;

  World& world_;
  const std::int64_t period_ns_;
  const StepScheduleOptions options_;
  StepAction next_ = StepAction::begin;  // `refresh`: the next of them, or else `begin`
  bool first_ = true;
  std::size_t refreshed_ = 0;  // times of refreshes that are behind
  std::int64_t step_ns_ = 0;   // grid point of the step under way, the last, or, at first, the first
  StepBegin begun_;
  StepReport report_;
};

}  // namespace hapticd
