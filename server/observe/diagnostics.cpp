#include "server/observe/diagnostics.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "haptic/clock.h"
#include "server/dds/borrowed.h"
#include "server/observe/dds_log.h"
#include "server/observe/instrument_shape.h"
#include "server/observe/log.h"
#include "server/observe/operation_message.h"
#include "server/os/realtime.h"
#include "server/record/contact_capture_file.h"

namespace hapticd {
namespace {

constexpr auto relaxed = std::memory_order_relaxed;
constexpr auto turn = std::chrono::milliseconds(20);
constexpr int turns_per_status = 5, turns_per_update = 2, turns_per_operation = 25;
constexpr std::int64_t geometry_every_ns = 100'000'000;  // a mesh that is being cut

nlohmann::json percentiles(const Histogram& histogram, double unit) {
  const HistogramSnapshot h = histogram.snapshot();
  return {{"p50", unit * h.percentile(50)},
          {"p99", unit * h.percentile(99)},
          {"p99_9", unit * h.percentile(99.9)},
          {"max", unit * static_cast<double>(h.max)},
          {"mean", unit * h.mean()},
          {"count", h.count}};
}

// [[middle in µs, count], …] of the bins that hold something.
nlohmann::json bins(const Histogram& histogram) {
  const HistogramSnapshot h = histogram.snapshot();
  nlohmann::json out = nlohmann::json::array();
  for (int i = 0; i < histogram_bins; ++i)
    if (h.bin[i] > 0) out.push_back({1e-3 * histogram_centre(i), h.bin[i]});
  return out;
}

std::vector<float> flat(const std::vector<Vec3>& nodes) {
  std::vector<float> out;
  out.reserve(3 * nodes.size());
  for (const Vec3& x : nodes)
    for (int i = 0; i < 3; ++i) out.push_back(static_cast<float>(x[i]));
  return out;
}

}  // namespace

nlohmann::json loop_summary(const LoopStatistics& s) {
  const std::uint64_t run = s.run.load(relaxed);
  const double elapsed = 1e-9 * static_cast<double>(s.next_ns.load(relaxed) - s.first_ns.load(relaxed));
  return {{"haptic_rate_hz", run > 0 && elapsed > 0 ? static_cast<double>(run) / elapsed : 0.0},
          {"haptic_deadline_misses", s.deadline_misses.load(relaxed)},
          {"slots_scheduled", s.scheduled()},
          {"slots_sent", run},
          {"slots_missed", s.missed.load(relaxed)},
          {"slots_answered", s.answered.load(relaxed)},
          {"late_states", s.late_states.load(relaxed)},
          {"wake_us", percentiles(s.wake, 1e-3)},
          {"timer_us", percentiles(s.timer, 1e-3)},
          {"solve_us", percentiles(s.solve, 1e-3)},
          {"write_us", percentiles(s.write, 1e-3)},
          {"interval_us", percentiles(s.interval, 1e-3)},
          {"state_age_us", percentiles(s.state_age, 1e-3)},
          {"problem_age_ms", percentiles(s.problem_age, 1e-6)},
          {"force_peak_n", s.force_peak.load(relaxed)},
          {"penetration_max_um", 1e6 * s.penetration_max.load(relaxed)},
          {"states_rejected", s.refused.load(relaxed)},
          {"conflicts", s.conflicts.load(relaxed)},
          {"solver_caps", s.solver_caps.load(relaxed)},
          {"contacts_dropped", s.contacts_dropped.load(relaxed)},
          {"page_faults", s.page_faults.load(relaxed)},
          {"wake_histogram", bins(s.wake)},
          {"timer_histogram", bins(s.timer)},
          {"solve_histogram", bins(s.solve)},
          {"write_histogram", bins(s.write)},
          {"interval_histogram", bins(s.interval)},
          {"state_age_histogram", bins(s.state_age)},
          {"problem_age_histogram", bins(s.problem_age)}};
}

Diagnostic diagnostic_of(const hapticd_msg_ServerStatus& m, std::int64_t time_ns) {
  Diagnostic d;
  d.time_ns = time_ns;
  d.level = m.status & status_errors      ? Diagnostic::error
            : m.status & ~status_ordinary ? Diagnostic::warning
                                          : Diagnostic::ok;
  d.name = "hapticd";
  d.message = d.level == Diagnostic::ok ? "all well" : "status " + std::to_string(m.status);
  d.values = {{"scene", m.scene},
              {"step", std::to_string(m.step)},
              {"ticks", std::to_string(m.ticks)},
              {"deadline_misses", std::to_string(m.deadline_misses)},
              {"haptic_rate_hz", std::to_string(m.haptic_rate_hz)},
              {"sim_rate_hz", std::to_string(m.sim_rate_hz)},
              {"sim_step_ms", std::to_string(m.sim_step_ms)},
              {"elements_removed", std::to_string(m.elements_removed)},
              {"fragments_aspirated", std::to_string(m.fragments_aspirated)},
              {"status", std::to_string(m.status)},
              {"rejected_states", std::to_string(m.rejected_states)},
              {"conflicts", std::to_string(m.conflicts)},
              {"samples_dropped", std::to_string(m.samples_dropped)},
              {"refused", m.refused}};
  return d;
}

Diagnostics::Diagnostics(const Participant& participant, const Scene& scene, const LoopStatistics& statistics,
                         Channel<SceneSnapshot>& snapshots, SpscQueue<ForceRecord>& history,
                         const std::optional<std::filesystem::path>& record,
                         const std::optional<DiagnosticsScope>& scope)
    : scene_(&scene),
      statistics_(statistics),
      snapshots_(snapshots),
      history_(history),
      status_(participant),
      geometry_(participant),
      update_(participant),
      instrument_writer_(participant),
      operation_(participant),
      scope_(scope.value_or(DiagnosticsScope{scene.first().device.id, true})),
      health_(participant, scene, scope_.device_id) {
  if (record && record->extension() == ".csv")
    record_.emplace(*record);
  else if (record)
    bag_.emplace(*record, scope_.device_id);
  if (scene.ros2) ros2_.emplace(participant, scope_.device_id);
}

Diagnostics::~Diagnostics() { stop(); }

void Diagnostics::write_captures(Channel<ContactCapture>& captures,
                                 const std::vector<Instrument>& instruments,
                                 const std::filesystem::path& directory, int most) {
  std::error_code error;
  std::filesystem::create_directories(directory, error);
  if (error) throw std::runtime_error(directory.string() + ": cannot be made: " + error.message());
  captures_ = &captures;
  instruments_ = &instruments;
  capture_directory_ = directory;
  most_captures_ = most;
}

void Diagnostics::write_capture_if_new() noexcept {
  if (!captures_ || captured() >= most_captures_ || !captures_->acquire()) return;
  char name[32];
  std::snprintf(name, sizeof name, "%06d.contact", captured() + 1);
  try {
    write_capture(capture_directory_ / name, *instruments_, captures_->front());
    captured_.store(captured() + 1, relaxed);
  } catch (const std::exception& e) {
    log(LogLevel::warning, "capture_failed", std::string("no more captures: ") + e.what());
    most_captures_ = 0;
  }
}

void Diagnostics::start(const std::vector<Grant>& grants, std::optional<int> realtime_core) {
  refused_.clear();
  for (const Grant& g : grants)
    if (!g.granted) refused_ += (refused_.empty() ? "" : ", ") + g.what;
  thread_ = std::thread([this, realtime_core] {
    name_thread("diagnostics");
    if (realtime_core) leave_core(*realtime_core);
    use_fifo(dds_priority);  // where that is refused it is to the haptic loop too, which has said so
    prefault_heap(sample_heap);
    run();
  });
}

void Diagnostics::stop() noexcept {
  stopping_.store(true, relaxed);
  if (!thread_.joinable()) return;
  thread_.join();
}

void Diagnostics::run() noexcept {
  publish_scene();
  for (std::uint64_t n = 0; !stopping_.load(relaxed); ++n) {
    drain();
    show_next();
    if (scope_.shows_scene) write_dds_log(monotonic_ns());
    write_capture_if_new();
    snapshots_.acquire();
    if (n % turns_per_update == 0) publish_update();
    if (n % turns_per_status == 0) publish_status();
    if (n % turns_per_operation == 0) publish_operation();
    std::this_thread::sleep_for(turn);
  }
  drain();
  write_capture_if_new();
  snapshots_.acquire();
  publish_update();
  publish_status();
  publish_operation();
  if (bag_) bag_->stop();
  if (!record_) return;
  record_->flush();
  recording_failed_.store(record_->failed(), relaxed);
}

void Diagnostics::drain() {
  ForceRecord record;
  while (history_.pop(record)) {
    health_.note(record);
    if (record_) write_line(record);
    if (bag_) bag_->push(record);
    if (ros2_) ros2_->note(record);
  }
  if (ros2_) ros2_->publish();
}

// A stream that has failed once (a full disk) is not written to again.
void Diagnostics::write_line(const ForceRecord& record) noexcept {
  std::atomic<std::uint64_t>& count = record_->failed() ? recording_lost_ : recorded_;
  count.store(count.load(relaxed) + 1, relaxed);
  if (record_->failed()) return;
  record_->write(record);
  if (!record_->failed()) return;
  recording_failed_.store(true, relaxed);
  log(LogLevel::error, "recording_ended",
      "the recording ends, everything else goes on: the file cannot be written");
}

void Diagnostics::publish_geometry(std::size_t b, std::vector<float>& rest, std::vector<std::uint32_t>& tets,
                                   std::vector<std::uint32_t>& opened) {
  const SceneBody& body = scene_->bodies[b];
  hapticd_msg_SceneGeometry m{};
  m.body = static_cast<std::uint32_t>(b);
  m.name = const_cast<char*>(body.name.c_str());
  m.deformable = body.kind == BodyKind::deformable;
  m.nodes = borrowed<decltype(m.nodes)>(rest);
  m.tets = borrowed<decltype(m.tets)>(tets);
  m.opened = borrowed<decltype(m.opened)>(opened);
  geometry_.write(m);
}

// Bodies that the next scene does not have are no more.
void Diagnostics::show_next() {
  const Scene* next = next_scene_.exchange(nullptr, std::memory_order_acquire);
  if (!next) return;
  for (std::size_t b = next->bodies.size(); scope_.shows_scene && b < scene_->bodies.size(); ++b) {
    hapticd_msg_SceneGeometry geometry{};
    hapticd_msg_SceneUpdate update{};
    geometry.body = update.body = static_cast<std::uint32_t>(b);
    geometry_.dispose(geometry);
    update_.dispose(update);
  }
  scene_ = next;
  updated_step_ = 0;
  health_.show(*next);
  publish_scene();
}

void Diagnostics::publish_scene() {
  if (!scope_.shows_scene) return;
  published_topology_.assign(scene_->bodies.size(), 0);
  for (std::size_t b = 0; b < scene_->bodies.size(); ++b) {
    const TetMesh& mesh = scene_->bodies[b].mesh;
    std::vector<float> nodes = flat(mesh.nodes);
    std::vector<std::uint32_t> tets, opened;
    tets.reserve(4 * mesh.tets.size());
    for (const Tet& t : mesh.tets) tets.insert(tets.end(), t.begin(), t.end());
    publish_geometry(b, nodes, tets, opened);
  }
  for (std::size_t i = 0; i < scene_->instruments.size(); ++i) {
    std::vector<float> shape = instrument_shape(scene_->instruments[i].shape);
    hapticd_msg_SceneInstrument m{};
    m.instrument = static_cast<std::uint32_t>(i);
    m.primitives = borrowed<decltype(m.primitives)>(shape);
    m.name = const_cast<char*>(scene_->instruments[i].name.c_str());
    m.device_id = scene_->instruments[i].device.id;
    m.instruments = static_cast<std::uint32_t>(scene_->instruments.size());
    instrument_writer_.write(m);
  }
}

void Diagnostics::publish_update() {
  const SceneSnapshot& snapshot = snapshots_.front();
  if (!scope_.shows_scene || snapshot.step == 0 || snapshot.step == updated_step_) return;
  updated_step_ = snapshot.step;
  std::vector<float> instruments;
  for (const Pose& X : snapshot.instruments) {
    for (int k = 0; k < 3; ++k) instruments.push_back(static_cast<float>(X.p[k]));
    for (int k = 0; k < 4; ++k) instruments.push_back(static_cast<float>(X.q.coeffs()[k]));
  }
  const std::int64_t now = monotonic_ns();
  const bool geometry_is_due = now - geometry_ns_ >= geometry_every_ns;
  for (std::size_t i = 0; i < std::min(snapshot.bodies.size(), published_topology_.size()); ++i) {
    const BodySnapshot& body = snapshot.bodies[i];
    if (body.nodes.empty()) continue;
    // After a cut: the new mesh first, and until it is due no places that the old one does not have.
    if (body.topology != published_topology_[i]) {
      if (!geometry_is_due) continue;
      publish_geometry(i, const_cast<std::vector<float>&>(body.rest),
                       const_cast<std::vector<std::uint32_t>&>(body.tets),
                       const_cast<std::vector<std::uint32_t>&>(body.opened));
      published_topology_[i] = body.topology;
      geometry_ns_ = now;
    }
    hapticd_msg_SceneUpdate m{};
    m.body = static_cast<std::uint32_t>(i);
    m.step = snapshot.step;
    m.nodes = borrowed<decltype(m.nodes)>(const_cast<std::vector<float>&>(body.nodes));
    m.alive = borrowed<decltype(m.alive)>(const_cast<std::vector<std::uint8_t>&>(body.alive));
    m.instruments = borrowed<decltype(m.instruments)>(instruments);
    m.contacts = borrowed<decltype(m.contacts)>(const_cast<std::vector<float>&>(snapshot.contacts));
    m.pressing = borrowed<decltype(m.pressing)>(const_cast<std::vector<std::uint8_t>&>(snapshot.pressing));
    update_.write(m);
  }
}

void Diagnostics::publish_status() {
  if (!scope_.shows_device) return;
  const std::int64_t now = monotonic_ns();
  const std::uint64_t run = statistics_.run.load(relaxed);
  if (rate_mark_ns_ == 0 || now - rate_mark_ns_ >= 1'000'000'000) {
    if (rate_mark_ns_ > 0)
      rate_hz_ = 1e9 * static_cast<double>(run - rate_mark_run_) / static_cast<double>(now - rate_mark_ns_);
    rate_mark_ns_ = now;
    rate_mark_run_ = run;
  }
  const SceneSnapshot& snapshot = snapshots_.front();
  hapticd_msg_ServerStatus m{};
  m.device_id = scope_.device_id;
  m.step = snapshot.step;
  m.ticks = run;
  m.deadline_misses = statistics_.deadline_misses.load(relaxed);
  m.haptic_rate_hz = static_cast<float>(rate_hz_);
  m.sim_rate_hz = static_cast<float>(snapshot.rate_hz);
  m.sim_step_ms = static_cast<float>(snapshot.step_ms);
  m.elements_removed = snapshot.elements_removed;
  m.fragments_aspirated = snapshot.fragments_aspirated;
  m.status = statistics_.status.load(relaxed);
  m.rejected_states = static_cast<std::uint32_t>(statistics_.refused.load(relaxed));
  m.conflicts = static_cast<std::uint32_t>(statistics_.conflicts.load(relaxed));
  m.samples = statistics_.samples.load(relaxed);
  m.samples_dropped = statistics_.samples_dropped.load(relaxed);
  m.scene = const_cast<char*>(scene_->name.c_str());
  m.refused = const_cast<char*>(refused_.c_str());
  status_.write(m);
  if (health_.heard())
    health_.publish(statistics_.wake.snapshot(), statistics_.solve.snapshot(), snapshot.health);
  if (bag_) bag_->push(diagnostic_of(m, now));
}

void Diagnostics::publish_operation() {
  const SceneSnapshot& snapshot = snapshots_.front();
  if (snapshot.operation.hands.empty() || operation_.matched() == 0) return;
  std::vector<hapticd_msg_HandOperation> hands;
  std::vector<hapticd_msg_BodyOperation> bodies;
  operation_.write(operation_message(scope_.device_id, scene_->name, snapshot.operation,
                                     snapshot.operation_events, hands, bodies));
}

}  // namespace hapticd
