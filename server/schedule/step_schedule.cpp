#include "server/schedule/step_schedule.h"

#include <utility>

namespace hapticd {

StepSchedule::StepSchedule(World& world, std::int64_t period_ns, const StepScheduleOptions& options)
    : world_(world), period_ns_(period_ns), options_(options) {}

void StepSchedule::warm_up(CondensedProblem& unpublished) {
  world_.step([] { return InstrumentSamples{}; }, unpublished);
  unpublished.step = 0;
}

PlannedAction StepSchedule::next_begin(std::int64_t now_ns) const noexcept {
  PlannedAction planned{StepAction::begin, step_ns_, step_ns_, 0, now_ns};
  if (first_) return planned;
  planned.step_ns += period_ns_;
  const std::int64_t late = now_ns - planned.step_ns;
  if (late > period_ns_) planned.skipped = late / period_ns_;
  planned.due_ns = planned.step_ns += planned.skipped * period_ns_;
  return planned;
}

std::int64_t StepSchedule::refresh_ns(std::size_t i) const noexcept {
  return step_ns_ + static_cast<std::int64_t>(options_.refresh_at[i] * static_cast<double>(period_ns_));
}

PlannedAction StepSchedule::next(std::int64_t now_ns) const noexcept {
  if (next_ == StepAction::begin) return next_begin(now_ns);
  if (next_ != StepAction::refresh) return {next_, now_ns, step_ns_, 0, now_ns};
  for (std::size_t i = refreshed_; i < options_.refresh_at.size(); ++i)
    if (now_ns <= refresh_ns(i)) return {StepAction::refresh, refresh_ns(i), step_ns_, 0, now_ns};
  return next_begin(now_ns);
}

void StepSchedule::perform(const PlannedAction& planned, StepHost& host) {
  switch (planned.action) {
    case StepAction::begin:
      step_ns_ = planned.step_ns;
      first_ = false;
      refreshed_ = 0;
      while (std::optional<ReferenceJob> job = host.finished_reference()) world_.adopt(std::move(*job));
      begun_ = world_.begin_step(host.latch(), options_.interims ? &host.problem() : nullptr);
      next_ = begun_.interim ? StepAction::publish_interim : StepAction::factor;
      return;
    case StepAction::publish_interim:
      host.publish(planned.action);
      next_ = StepAction::factor;
      return;
    case StepAction::factor:
      world_.factor_step();
      next_ = StepAction::finish;
      return;
    case StepAction::finish:
      report_ = world_.finish_step(host.latch(), host.problem());
      next_ = StepAction::publish;
      return;
    case StepAction::publish:
      host.publish(planned.action);
      world_.look_for_cracks();
      for (ReferenceJob& job : world_.wanted_references()) host.make_reference(std::move(job));
      next_ = world_.wants_refresh() ? StepAction::refresh : StepAction::begin;
      return;
    case StepAction::refresh:
      while (refreshed_ < options_.refresh_at.size() && refresh_ns(refreshed_) <= planned.due_ns)
        ++refreshed_;
      if (world_.refresh(host.latch(), host.problem())) next_ = StepAction::publish_refresh;
      return;
    case StepAction::publish_refresh:
      host.publish(planned.action);
      next_ = StepAction::refresh;
      return;
  }
}

}  // namespace hapticd
