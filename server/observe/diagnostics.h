// The thread that talks: status, scene and recording, at `dds_priority`, fed by queues and channels.
//
//   10 Hz   ServerStatus            from the loop's statistics and the newest snapshot
//   10 Hz   ServerHealth            while somebody listens (health.h)
//   2 Hz    SceneOperation          while somebody listens (operation.h)
//   once    SceneGeometry           per body, kept by DDS for late readers; SceneInstrument
//   25 Hz   SceneUpdate             per deformable body, from the newest snapshot
//   50 Hz   the ROS 2 mirror        of the newest tick, where the scene asks for it (ros2_mirror.h)
//   50 Hz   the force history       drained, and written to the recording if there is one: a CSV file
//                                   (force_record.h), or a rosbag2 directory on a thread of its own
//                                   (bag_recorder.h)
//
// Neither loop ever waits for it: a full queue drops and counts, a channel keeps the newest.
// Thread safety: start, stop and the constructor belong to one thread; the diagnostics thread alone
// reads `snapshots` and pops from `history`.
// Errors: the constructor throws std::runtime_error (recording, DDS).
#pragma once

#include <atomic>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <thread>
#include <vector>

#include "haptic/loop.h"
#include "server/dds/dds.h"
#include "server/dds/ros2_mirror.h"
#include "server/observe/bag_recorder.h"
#include "server/observe/body_snapshot.h"
#include "server/observe/health.h"
#include "server/observe/operation.h"
#include "server/os/realtime.h"
#include "server/record/force_record.h"
#include "server/scene/scene.h"

namespace hapticd {

// What the simulation thread hands over after a step. Sizes change with cuts alone.
struct SceneSnapshot {
  std::uint64_t step = 0;              // 0: none yet
  std::vector<BodySnapshot> bodies;    // in the scene's order
  std::vector<Pose> instruments;       // in the scene
  std::vector<float> contacts;         // 7 each (idl/scene.idl)
  std::vector<std::uint8_t> pressing;  // 2 per contact (idl/scene.idl)
  std::uint32_t elements_removed = 0;
  std::uint32_t fragments_aspirated = 0;
  double step_ms = 0;
  double rate_hz = 0;
  StepHealth health;
  OperationMeasures operation;         // of a world's first device; others have no hands
  std::uint64_t operation_events = 0;  // of which `operation` has the newest
};

// The loop's statistics under the names that summaries use: haptic_rate_hz, haptic_deadline_misses,
// slots_scheduled, slots_sent, slots_missed, slots_answered, wake_us, timer_us, solve_us,
// write_us, interval_us, state_age_us, problem_age_ms (each p50, p99, p99_9, max, mean, count), force_peak_n,
// penetration_max_um, states_rejected, conflicts, solver_caps, contacts_dropped (ticks), page_faults;
// wake_histogram and likewise for the others ([[middle of a bin in µs, count], …], so that a caller can
// subtract two summaries).
nlohmann::json loop_summary(const LoopStatistics& statistics);

// Bits of a status (haptic/device.h) that are an error; those that are no fault.
inline constexpr std::uint32_t status_errors =
    status_problem_lost | status_latched | status_not_finite | status_rival;
inline constexpr std::uint32_t status_ordinary =
    status_disarmed | status_ramping_up | status_saturated | status_slew_limited | status_blending;

// A status as a recording keeps it.
Diagnostic diagnostic_of(const hapticd_msg_ServerStatus& status, std::int64_t time_ns);

// Whose status is published, if there is a haptic half here, and whether the scene is: bodies have one key
// for all devices.
struct DiagnosticsScope {
  std::uint32_t device_id = 0;
  bool shows_scene = true;
  bool shows_device = true;
};

class Diagnostics {
 public:
  // Everything referred to must outlive the object. record: what to write, if anything: a name that ends in
  // .csv is a CSV file, any other a rosbag2 directory. scope: default, the scene's first device and the
  // scene.
  Diagnostics(const Participant& participant, const Scene& scene, const LoopStatistics& statistics,
              Channel<SceneSnapshot>& snapshots, SpscQueue<ForceRecord>& history,
              const std::optional<std::filesystem::path>& record,
              const std::optional<DiagnosticsScope>& scope = {});

  // Writes captured contact problems as DIRECTORY/000001.contact and so on, at most `most` of them. Before
  // start. Throws std::runtime_error where the directory cannot be made.
  void write_captures(Channel<ContactCapture>& captures, const std::vector<Instrument>& instruments,
                      const std::filesystem::path& directory, int most = 500);
  int captured() const noexcept { return captured_.load(std::memory_order_relaxed); }
  ~Diagnostics();
  Diagnostics(const Diagnostics&) = delete;
  Diagnostics& operator=(const Diagnostics&) = delete;

  // grants: what the operating system refused is part of every status. realtime_core: the thread keeps off
  // it.
  void start(const std::vector<Grant>& grants = {}, std::optional<int> realtime_core = {});
  // Another scene, or the same from its start: shown from the thread's next turn on. Any thread; the scene
  // before must live on until then, and for a second.
  void show(const Scene& scene) noexcept { next_scene_.store(&scene, std::memory_order_release); }
  // Drains what the loop left, publishes a last status, closes the recording. Idempotent.
  void stop() noexcept;

  bool recording_failed() const noexcept {
    return recording_failed_.load(std::memory_order_relaxed) || (bag_ && bag_->failed());
  }
  // Of what the loop handed over: messages of a bag, or lines. Beside them stands what never reached the
  // diagnostics thread (SpscQueue::dropped).
  std::uint64_t recorded() const noexcept {
    return bag_ ? bag_->kept() : recorded_.load(std::memory_order_relaxed);
  }
  std::uint64_t recording_lost() const noexcept {
    return bag_ ? bag_->lost() : recording_lost_.load(std::memory_order_relaxed);
  }

 private:
  void run() noexcept;
  void drain();
  void write_line(const ForceRecord& record) noexcept;
  void publish_scene();
  void show_next();
  void publish_geometry(std::size_t body, std::vector<float>& rest, std::vector<std::uint32_t>& tets,
                        std::vector<std::uint32_t>& opened);
  void publish_status();
  void publish_operation();
  void publish_update();
  void write_capture_if_new() noexcept;

  const Scene* scene_;
  std::atomic<const Scene*> next_scene_{nullptr};
  const LoopStatistics& statistics_;
  Channel<SceneSnapshot>& snapshots_;
  SpscQueue<ForceRecord>& history_;
  std::optional<ForceRecordWriter> record_;
  std::optional<BagRecorder> bag_;
  Channel<ContactCapture>* captures_ = nullptr;
  const std::vector<Instrument>* instruments_ = nullptr;
  std::filesystem::path capture_directory_;
  int most_captures_ = 0;
  std::atomic<int> captured_{0};
  std::optional<Ros2Mirror> ros2_;
  Writer<hapticd_msg_ServerStatus> status_;
  Writer<hapticd_msg_SceneGeometry> geometry_;
  Writer<hapticd_msg_SceneUpdate> update_;
  Writer<hapticd_msg_SceneInstrument> instrument_writer_;
  Writer<hapticd_msg_SceneOperation> operation_;
  const DiagnosticsScope scope_;
  HealthPublisher health_;
  std::string refused_;              // "", or what of the real-time set-up is missing
  std::uint64_t rate_mark_run_ = 0;  // where the present window of the rate began
  std::int64_t rate_mark_ns_ = 0;
  double rate_hz_ = 0;
  std::uint64_t updated_step_ = 0;
  std::vector<int> published_topology_;  // per body
  std::int64_t geometry_ns_ = 0;         // when one was last published after a cut
  std::atomic<bool> recording_failed_{false};
  std::atomic<std::uint64_t> recorded_{0}, recording_lost_{0};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace hapticd
