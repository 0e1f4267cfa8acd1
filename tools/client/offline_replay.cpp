#include "tools/client/offline_replay.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <stdexcept>
#include <utility>

#include "haptic/haptic_step.h"
#include "server/scene/scene_world.h"
#include "tools/cli/interrupt.h"
#include "tools/cli/progress.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;
constexpr std::int64_t first_ns = 1'000 * ms;  // of tick 0; 0 would mean "never" to the watchdog
constexpr std::int64_t state_age_ns = ms / 2, reference_after_ns = 40 * ms;
constexpr std::int64_t interim_after_ns = 2 * ms, publish_after_ns = 10 * ms;
constexpr std::int64_t slots_before_enable = 50, arming_slots = 250;

InstrumentSample sample_of(const InstrumentInput& i) {
  return {i.X, i.present, (i.buttons & pedal_phaco) != 0, (i.buttons & pedal_aspiration) != 0};
}

// The simulation thread in virtual time.
class Simulation {
 public:
  explicit Simulation(const Scene& scene)
      : world_(make_world(scene)),
        period_ns_(std::llround(1e9 / scene.rate)),
        latch_ns_(std::clamp<std::int64_t>(scene.contact == Renewal::renewed ? ms : 6 * ms, 0,
                                           std::max<std::int64_t>(0, period_ns_ - ms))),
        publish_ns_(std::min(publish_after_ns, period_ns_)),
        inputs_(static_cast<std::size_t>(period_ns_ / ms + 2)) {
    if (period_ns_ < ms) throw std::invalid_argument("the simulation cannot be faster than the haptic loop");
    // As the daemon does before its clock starts.
    world_->step([] { return InstrumentSample{}; }, *in_use_);
    in_use_->step = 0;
  }

  // What the tick `i` left for the simulation.
  void note(std::int64_t i, const InstrumentInput& input) {
    inputs_[static_cast<std::size_t>(i) % inputs_.size()] = input;
  }
  // True if another problem is in use from tick `i` on.
  bool advance(std::int64_t i) {
    const std::int64_t begin = steps_ * period_ns_;
    if (!stepped_ && begin + std::min(publish_ns_, std::max(latch_ns_, interim_after_ns)) <= i * ms) {
      step(begin);
      if (report_.interim) in_use_->published_ns = first_ns + i * ms;
      stepped_ = true;
    }
    if (!stepped_ || begin + publish_ns_ > i * ms) return false;
    std::swap(in_use_, next_);
    in_use_->published_ns = first_ns + i * ms;
    stepped_ = false;
    ++steps_;
    return true;
  }

  const World& world() const { return *world_; }
  const StepReport& report() const { return report_; }
  std::uint32_t removed() const { return static_cast<std::uint32_t>(world_->removed()); }
  const CondensedProblem* problem() const { return in_use_->step > 0 ? in_use_.get() : nullptr; }

 private:
  struct Base {
    std::int64_t ready_ns;
    ReferenceJob job;
  };

  // As of the newest tick before that time.
  InstrumentSample at(std::int64_t ns) const {
    const std::int64_t i = (ns + ms - 1) / ms - 1;
    return i < 0 ? InstrumentSample{} : sample_of(inputs_[static_cast<std::size_t>(i) % inputs_.size()]);
  }
  void step(std::int64_t begin) {
    for (; !bases_.empty() && bases_.front().ready_ns <= begin; bases_.pop_front())
      world_->adopt(std::move(bases_.front().job));
    bool latched = false;
    report_ =
        world_->step([&] { return at(std::exchange(latched, true) ? begin + latch_ns_ : begin); }, *next_,
                     [&]() -> CondensedProblem& {
                       std::swap(in_use_, next_);
                       return *next_;
                     });
    for (ReferenceJob& job : world_->wanted_references()) {
      try {
        job.reference->make();
      } catch (const std::runtime_error&) {
        job.failed = true;
      }
      bases_.push_back({begin + reference_after_ns, std::move(job)});
    }
  }

  std::unique_ptr<World> world_;
  std::unique_ptr<CondensedProblem> in_use_ = std::make_unique<CondensedProblem>(),
                                    next_ = std::make_unique<CondensedProblem>();
  bool stepped_ = false;  // step `steps_` was made: its problem is `next_`
  const std::int64_t period_ns_, latch_ns_, publish_ns_;
  std::vector<InstrumentInput> inputs_;  // of the newest ticks, a period's and one more
  std::int64_t steps_ = 0;
  StepReport report_;
  std::deque<Base> bases_;
};

}  // namespace

bool replay_offline(const Scene& scene, SlotSource& source, std::int64_t slots, const ReplaySinks& sinks) {
  Simulation simulation(scene);
  const HapticOptions options = haptic_options(scene);
  const auto state = std::make_unique<HapticState>();
  Progress progress("offline");
  ReplayedTick now;
  NewestForce newest;
  std::vector<ContactForce> contacts;
  for (std::int64_t i = 0; i < arming_slots + slots; ++i) {
    const std::int64_t now_ns = first_ns + i * ms;
    now.slot = i - arming_slots;
    if (simulation.advance(i) && sinks.step)
      sinks.step({now.slot, simulation.world(), simulation.report(), now.record.force,
                  now.record.instrument.X, contacts, simulation.removed()});
    now.command = now.slot < 0 ? source.first() : source.at(now.slot, now_ns, newest, i > 0);

    HapticInput input;
    input.now_ns = now_ns;
    input.presence = {.connected = true, .new_client = i == 0, .conflict = false};
    input.taken = true;
    input.sample.sequence = static_cast<std::uint64_t>(i + 1);
    input.sample.client_time_ns = input.sample.received_ns = now_ns - state_age_ns;
    input.sample.pose = now.command.pose;
    input.sample.buttons = now.command.buttons;
    input.sample.enable = i >= slots_before_enable;
    const ForceSample force =
        haptic_step(simulation.problem(), scene.instrument, scene.device, options, input, *state);
    const InstrumentInput instrument =
        instrument_input(scene.device, options.watchdog, state->watchdog, now_ns);
    simulation.note(i, instrument);
    newest = {force.force, now_ns};
    now.record = {now_ns, force, state->watchdog.sample.pose, instrument};
    now.removed = simulation.removed();
    contacts = state->solved ? contact_forces(state->scratch, state->solution.instrument)
                             : std::vector<ContactForce>{};
    if (sinks.tick) sinks.tick(now);
    if (i % 100 == 0) {
      if (interrupted()) return false;
      progress.show(static_cast<double>(i) / static_cast<double>(arming_slots + slots),
                    std::to_string(now.removed) + " removed");
    }
  }
  return true;
}

}  // namespace hapticd
