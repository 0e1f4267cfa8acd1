// The daemon of one world in virtual time: its schedule and its haptic tick in one thread, without a clock.
//
//   simulation   StepSchedule's actions at the times of VirtualTiming, after those before them have ended
//   haptic       a tick (haptic_tick.h) whenever the caller has one, on the newest problem published by then
//   order        at one instant: publication → tick → latch. A problem published at t is felt by the tick at
//   t,
//                whose instrument a step that latches at t knows.
//
// Nothing depends on the machine's clock: two runs of the same inputs agree bit for bit. Delays are settings
// because the live daemon's are not constant; defaults are its medians on the cataract scene. Actions are
// performed when time passes them, so poses may depend on the forces before. Units: ns, as haptic_step.h.
// Errors: what World throws; std::invalid_argument for a period below 0.1 ms.
#pragma once

#include <deque>
#include <functional>
#include <memory>

#include "haptic/haptic_tick.h"
#include "server/edge/remote_hand.h"
#include "server/scene/scene.h"
#include "server/schedule/step_schedule.h"
#include "server/schedule/virtual_link.h"

namespace hapticd {

// When what happens, after a step's begin unless said otherwise [ns].
struct VirtualTiming {
  std::int64_t interim = 2'000'000;        // its interim problem is published
  std::int64_t latch = 1'000'000;          // the pose of its contact solve
  std::int64_t removal_latch = 4'000'000;  // … at least, where something went: the factor comes first
  std::int64_t publish = 10'000'000;       // its problem is; at most a period …
  std::int64_t late = 0;                // … and so much later, the pose of its contact by a third of that
  std::int64_t refresh = 2'000'000;     // a problem made again is published, after its pose
  std::int64_t reference = 40'000'000;  // a reference factor is ready, after the begin of the step that asked
  std::int64_t far_tissue = 100'000'000;  // … what is far from a region
};

// The defaults; latch 6 ms where the world does not look ahead, because its factor comes first.
VirtualTiming usual_timing(const World& world);

struct VirtualDaemonSettings {
  std::optional<VirtualTiming> timing;  // absent: usual_timing
  StepScheduleOptions schedule;
  std::int64_t first_ns = 1'000'000'000;  // of the first step, and of the first tick at the earliest; above 0
  std::int64_t stall_from = 0, stall_to = 0;  // no step begins from … to
  // Around each action, at its time; and instead of `reference->make()`. Absent: nothing, and that.
  std::function<void(StepAction, std::int64_t)> before, after;
  std::function<void(ReferenceFactor&)> make;
  // What becomes of a problem on its way to the tick. Absent: nothing.
  std::function<void(CondensedProblem&)> carried;
  std::optional<LinkTrouble> link;  // between the halves (server/edge); absent: they are one process
  // With a link: whose devices are answered beside the simulation, the others at the edge; none: all at the
  // edge.
  EachInstrument<bool> at_simulation = {};
};

class VirtualDaemon final : private StepHost {
 public:
  // devices: one an instrument, in their order.
  VirtualDaemon(std::unique_ptr<World> world, double rate, std::vector<DeviceSettings> devices,
                const HapticOptions& options, VirtualDaemonSettings settings = {});
  VirtualDaemon(std::unique_ptr<World> world, double rate, const DeviceSettings& one,
                const HapticOptions& options, VirtualDaemonSettings settings = {})
      : VirtualDaemon(std::move(world), rate, std::vector<DeviceSettings>{one}, options,
                      std::move(settings)) {}

  // A tick at input.now_ns, which rises; the simulation first, as far as it is by then.
  EachInstrument<ForceSample> tick(const HapticInput& input);

  // For a tick that somebody else makes: the simulation until then, and what it is told after it.
  void advance(std::int64_t now_ns);
  void tell(const InstrumentInputs& instruments);

  // For actions to come.
  void set_timing(const VirtualTiming& timing) { timing_ = timing; }
  void schedule_removal(int body, std::vector<int> tets) { world_->schedule_removal(body, std::move(tets)); }

  const World& world() const { return *world_; }
  World& world() { return *world_; }                    // between ticks
  const HapticTick& haptic() const { return haptic_; }  // of two, the one beside the simulation
  // As who answers it has it.
  const DeviceState& device_state(int i) const;
  const StepSchedule& schedule() const { return schedule_; }
  // Published last, or null; of two halves only right after the publication.
  const CondensedProblem* newest();
  const InstrumentInputs& told() const { return told_; }

 private:
  struct Reference {
    std::int64_t ready_ns;
    ReferenceJob job;
  };

  // The halves' link, and what is on it.
  struct Halves {
    explicit Halves(const LinkTrouble& trouble) : link(trouble) {}
    VirtualLink link;
    CondensedProblem made;  // the simulation's own
    Underway<std::unique_ptr<CondensedProblem>> problems;
    Underway<InstrumentInputs> hands;
  };

  // The edge, where another loop is beside the simulation.
  struct Edge {
    Edge(Instruments instruments, const std::vector<DeviceSettings>& devices, const HapticOptions& options,
         const EachInstrument<bool>& at_simulation);
    Channel<CondensedProblem> problems;
    HapticTick haptic;
    Underway<InstrumentInputs> others;
    Channel<InstrumentInputs> told_here, told_there;
    RemoteHands hands_here{told_here}, hands_there{told_there};
    EachInstrument<std::optional<RemotePort>> port;  // in the loop that does not answer it
  };

  EachInstrument<ForceSample> tick_both(const HapticInput& input);
  bool is_whole_loop_away() const { return halves_ && !edge_; }
  std::int64_t time_of(const PlannedAction& planned) const;
  void deliver(std::int64_t now_ns);

  InstrumentSamples latch() override;
  CondensedProblem& problem() override { return is_whole_loop_away() ? halves_->made : problems_.back(); }
  void publish(StepAction as) override;
  std::optional<ReferenceJob> finished_reference() override;
  void make_reference(ReferenceJob job) override;

  VirtualDaemonSettings settings_;
  std::unique_ptr<World> world_;
  StepSchedule schedule_;
  VirtualTiming timing_;
  Channel<CondensedProblem> problems_;
  HapticTick haptic_;
  InstrumentInputs told_;
  std::unique_ptr<Halves> halves_;
  std::unique_ptr<Edge> edge_;
  std::deque<Reference> references_;
  std::int64_t now_ns_ = 0;      // as far as time has passed
  std::int64_t free_ns_;         // the simulation's last action ended
  std::int64_t begun_ns_ = 0;    // the step under way, or the last, began
  std::int64_t refresh_ns_ = 0;  // the last refresh latched its pose
};

// The inverse of to_scene.
Pose to_device(const DeviceSettings& device, const Pose& scene);

}  // namespace hapticd
