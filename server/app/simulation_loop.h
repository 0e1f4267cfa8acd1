// The simulation thread: a world stepped at the scene's rate, its problems published to the haptic loop.
//
//   wait until the schedule says (step_schedule.h) → perform its action; after a step: snapshot for display
//
// Time: an absolute grid on CLOCK_MONOTONIC. Of grid points that the schedule leaves out (`overruns` counts
// them) simulation time falls behind real time by as much.
// Thread safety: start and stop belong to one thread; statistics may be read by any. The loop's thread
// alone writes `problems` and `snapshots` and reads `instruments`.
// Errors: an exception in a step (a singular body) ends the loop and is kept in `failure()`; the haptic
// loop then lets the force go by the problem's age.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "haptic/channel.h"
#include "haptic/haptic_step.h"
#include "haptic/histogram.h"
#include "haptic/spsc_queue.h"
#include "server/app/reference_maker.h"
#include "server/observe/diagnostics.h"
#include "server/observe/operation.h"
#include "server/schedule/step_record.h"

namespace hapticd {

struct SimulationStatistics {
  Histogram step;     // compute time of a step, reference factors adopted and asked for included
  Histogram interim;  // from a step's begin to the publication of its interim problem
  Histogram refresh;  // from the latch of a problem made again to its publication
  std::atomic<std::uint64_t> late_removals{0};  // steps that removed something and had none
  std::atomic<std::uint64_t> steps{0};
  std::atomic<std::uint64_t> overruns{0};         // grid points left out
  std::atomic<std::uint64_t> removed{0};          // tetrahedra
  std::atomic<std::uint64_t> aspirated{0};        // fragments
  std::atomic<std::uint64_t> cut_steps{0};        // in which blades cut or faces tore
  std::atomic<bool> out_of_room{false};           // a cut found none left: nothing is cut any more
  std::atomic<std::uint64_t> condensed_steps{0};  // in which an instrument reached condensed tissue
  std::atomic<std::uint64_t> references{0};       // adopted
  std::atomic<std::uint64_t> references_failed{0};
  std::atomic<std::uint64_t> synchronous_references{0};  // made by a step, for others came too late
  std::atomic<std::uint64_t> rough_steps{0};             // with a compliance `degraded`
  std::atomic<double> compliance_error{0};               // largest sampled
  std::atomic<double> rotation{0};    // largest of a zone node since its reference factor [rad]
  std::atomic<double> force_peak{0};  // on the instrument [N]
  std::atomic<double> jump_at_reference{
      0};  // StepReport::handover_jump, largest in steps with a new reference factor alone
  std::atomic<double> jump_at_removal{0};  // … in steps that removed something
  std::atomic<std::int64_t> first_ns{0};   // intended time of the first step
  std::atomic<std::int64_t> last_ns{0};    // intended time of the newest step

  double rate_hz() const noexcept {
    const auto n = steps.load(std::memory_order_relaxed);
    const auto span = last_ns.load(std::memory_order_relaxed) - first_ns.load(std::memory_order_relaxed);
    return n > 1 && span > 0 ? 1e9 * static_cast<double>(n - 1) / static_cast<double>(span) : 0;
  }
};

class SimulationLoop final : private StepHost {
 public:
  // snapshots: a reader each; the bodies are in the first one's alone. Everything referred to must outlive
  // the loop.
  SimulationLoop(World& world, PartTimes& times, double rate, Channel<InstrumentInputs>& instruments,
                 Channel<CondensedProblem>& problems, std::vector<Channel<SceneSnapshot>*> snapshots);
  ~SimulationLoop() override;
  SimulationLoop(const SimulationLoop&) = delete;
  SimulationLoop& operator=(const SimulationLoop&) = delete;

  // Before `start`: the step that is on no clock (StepSchedule::warm_up).
  void warm_up() { schedule_.warm_up(problems_.back()); }

  // Records what each action met; what does not fit is dropped and counted by the queue. Before start; the
  // queue must outlive the loop.
  void record_into(SpscQueue<StepRecord>& records) noexcept { records_ = &records; }

  // Each publication is copied there too, for a haptic half in another process. Before start; the channel
  // must outlive the loop.
  void share_into(Channel<CondensedProblem>& copies) noexcept { copies_ = &copies; }

  // on_thread runs on the new thread before its first step: the place for affinity. The thread that makes
  // reference factors takes whatever time any core has left.
  void start(std::function<void()> on_thread = {});
  void stop() noexcept;

  // For tests of the daemon as a process (hapticd --test-hooks): the next step begins so much later; the next
  // problem is not finite.
  void hold(std::int64_t ns) noexcept { hold_ns_.store(ns, std::memory_order_relaxed); }
  void poison() noexcept { poisoned_.store(true, std::memory_order_relaxed); }

  bool failed() const noexcept { return failed_.load(std::memory_order_acquire); }
  const std::string& failure() const noexcept { return failure_; }  // after failed()
  const SimulationStatistics& statistics() const noexcept { return statistics_; }
  const Histogram& reference_time() const noexcept { return references_.make_time(); }
  OperationMeasures operation() const { return operation_.measures(); }

 private:
  void run();
  void perform(const PlannedAction& planned);
  void begin_counting(const PlannedAction& planned);
  void end_counting();
  void count(const StepReport& report);
  void record(const StepRecord& record) noexcept {
    if (records_) records_->push(record);
  }

  InstrumentSamples latch() override;
  CondensedProblem& problem() override { return problems_.back(); }
  void publish(StepAction as) override;
  std::optional<ReferenceJob> finished_reference() override;
  void make_reference(ReferenceJob job) override {
    (job.kind == JobKind::far_tissue ? far_tissue_ : references_).give(std::move(job));
  }

  void publish_snapshots(std::int64_t step_ns, const StepReport& report);
  void show_bodies(const StepReport& report, SceneSnapshot& snapshot);

  World& world_;
  PartTimes& times_;
  StepSchedule schedule_;
  Channel<InstrumentInputs>& instruments_;
  Channel<CondensedProblem>& problems_;
  std::vector<Channel<SceneSnapshot>*> snapshots_;
  SimulationStatistics statistics_;
  Operation operation_;
  std::int64_t followed_ns_ = 0;                    // intended time of the last step that it followed
  std::array<std::int64_t, step_parts> part_ns_{};  // summed
  ReferenceMaker references_, far_tissue_;  // what is far from a region takes longer, and nobody waits for it
  PlannedAction now_;                       // that is being performed
  std::int64_t begun_ns_ = 0;               // of the step or the refresh under way
  std::int64_t published_ns_ = 0;           // the last problem
  SpscQueue<StepRecord>* records_ = nullptr;
  Channel<CondensedProblem>* copies_ = nullptr;
  std::atomic<std::int64_t> hold_ns_{0};
  std::atomic<bool> poisoned_{false};
  std::atomic<bool> stopping_{false};
  std::atomic<bool> failed_{false};
  std::string failure_;
  std::thread thread_;
};

}  // namespace hapticd
