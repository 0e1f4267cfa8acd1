#include "server/schedule/schedule_replay.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "haptic/haptic_tick.h"
#include "server/scene/scene_world.h"

namespace hapticd {
namespace {

// The clock of a tick, as it answered then.
struct RecordedClock {
  const std::int32_t* answers;
  std::size_t kept;
  mutable std::size_t asked = 0;

  static std::int64_t left_ns(const void* clock) noexcept {
    const auto& self = *static_cast<const RecordedClock*>(clock);
    const std::size_t i = self.asked++;
    return self.kept == 0 ? 0 : self.answers[std::min(i, self.kept - 1)];
  }
};

// The simulation, action by action as recorded.
class Simulation final : private StepHost {
 public:
  Simulation(const Scene& scene, const Schedule& schedule)
      : steps_(schedule.steps),
        world_(make_world(scene)),
        schedule_(*world_, std::llround(1e9 / scene.rate)) {
    schedule_.warm_up(problems_.back());
    if (!steps_.empty()) schedule_.start(beginning().step_ns);
  }

  // Until that publication. False: the record ends before.
  bool run_until(std::uint64_t problem) {
    while (published_ < problem) {
      if (next_ == steps_.size()) return false;
      // A `factor` leaves no record; what follows it does.
      const PlannedAction planned = schedule_.next(beginning().asked_ns);
      if (planned.action != StepAction::factor)
        require(planned.action == beginning().action, "another action");
      now_ = planned.action;
      try {
        schedule_.perform(planned, *this);
      } catch (const EndOfRecord&) {
        return false;
      }
    }
    if (published_ != problem) fail("a publication that was not made");
    return true;
  }

  Channel<CondensedProblem>& problems() { return problems_; }
  const World& world() const { return *world_; }
  std::uint64_t publications() const { return publications_; }
  std::uint64_t references() const { return references_; }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw std::runtime_error("the run goes another way than its record, at action " + std::to_string(next_) +
                             ": " + what);
  }
  void require(bool as_recorded, const char* otherwise) const {
    if (!as_recorded) fail(otherwise);
  }

  // Of the next action: reference factors that are adopted in it come before.
  const StepRecord& beginning() const {
    std::size_t i = next_;
    while (i + 1 < steps_.size() && steps_[i].adopted) ++i;
    return steps_[i];
  }
  const StepRecord& take(StepAction action) {
    if (next_ == steps_.size()) throw EndOfRecord{};
    const StepRecord& record = steps_[next_];
    require(!record.adopted && record.action == action, "another action");
    ++next_;
    return record;
  }

  InstrumentSamples latch() override { return take(now_).samples; }
  CondensedProblem& problem() override { return problems_.back(); }
  void publish(StepAction as) override {
    const StepRecord& record = take(as);
    require(problems_.back().step == record.problem, "another publication");
    problems_.back().published_ns = record.published_ns;
    problems_.publish();
    published_ = record.problem;
    ++publications_;
  }
  std::optional<ReferenceJob> finished_reference() override {
    if (next_ == steps_.size() || !steps_[next_].adopted) return std::nullopt;
    const StepRecord& record = steps_[next_++];
    const auto job = std::find_if(making_.begin(), making_.end(), [&](const ReferenceJob& j) {
      return j.body == record.body && j.kind == record.kind;
    });
    require(job != making_.end(), "a reference factor that nobody asked for");
    ReferenceJob made = std::move(*job);
    making_.erase(job);
    made.failed = record.failed;
    if (!made.failed) made.reference->make();
    ++references_;
    return made;
  }
  void make_reference(ReferenceJob job) override { making_.push_back(std::move(job)); }

  struct EndOfRecord {};

  const std::vector<StepRecord>& steps_;
  std::unique_ptr<World> world_;
  StepSchedule schedule_;
  Channel<CondensedProblem> problems_;
  std::vector<ReferenceJob> making_;
  std::size_t next_ = 0;  // record
  StepAction now_ = StepAction::begin;
  std::uint64_t published_ = 0, publications_ = 0, references_ = 0;
};

HapticInput input_of(const TickFacts& facts) {
  HapticInput input;
  input.now_ns = facts.now_ns;
  input.period_ns = facts.period_ns;
  for (int i = 0; i < facts.devices; ++i) input.device[i] = facts.device[i].input;
  return input;
}

}  // namespace

Reproduction replay_schedule(const Scene& scene, const Schedule& schedule,
                             const std::function<bool(const ReproducedTick&)>& each) {
  Simulation simulation(scene, schedule);
  HapticTick haptic(simulation.world().instruments(), devices_of(scene), haptic_options(scene),
                    simulation.problems());
  Reproduction out;
  std::uint64_t before = 0;
  for (const RecordedTick& tick : schedule.ticks) {
    const TickFacts& live = tick.facts;
    if (!simulation.run_until(live.problem)) {
      out.without_problem = schedule.ticks.size() - out.ticks;
      break;
    }
    out.gaps += before > 0 ? live.tick - before - 1 : live.tick - 1;
    before = live.tick;
    for (int i = 0; i < live.devices; ++i)
      if (live.device[i].retuned) haptic.retune(i, live.device[i].tuning);
    HapticInput input = input_of(live);
    const RecordedClock clock{schedule.answers.data() + tick.first, tick.kept};
    input.deadline = {RecordedClock::left_ns, &clock, 0};
    const EachInstrument<ForceSample> force = haptic.run(input);
    ++out.ticks;
    out.unsure += clock.asked != tick.asked || tick.asked > tick.kept;
    double off = 0;
    bool other_status = false;
    for (int i = 0; i < live.devices; ++i) {
      const DeviceFacts& then = live.device[i];
      other_status = other_status || force[i].status != then.status;
      const double off_by = (force[i].force - then.force).norm();
      off = off_by <= off ? off : off_by;  // also where it is no number
      out.largest_torque_off = std::max(out.largest_torque_off, (force[i].torque - then.torque).norm());
    }
    out.other_status += other_status;
    if (!(off <= out.largest_off)) {
      out.largest_off = off;
      out.worst_tick = live.tick;
    }
    if (each && !each({live, force, off})) break;
  }
  out.removed = simulation.world().removed();
  out.publications = simulation.publications();
  out.references = simulation.references();
  return out;
}

}  // namespace hapticd
