#include "tools/view/playback.h"

#include <atomic>
#include <cmath>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "haptic/clock.h"
#include "server/observe/diagnostics.h"
#include "server/observe/instrument_shape.h"
#include "server/observe/operation_message.h"
#include "server/record/bag_reader.h"
#include "server/record/trajectory_reader.h"
#include "server/scene/scene_describe.h"
#include "server/scene/scene_reader.h"
#include "tools/cli/command.h"
#include "tools/client/offline_replay.h"
#include "tools/view/live.h"
#include "tools/view/scene.h"

namespace hapticd {
namespace {

constexpr double longest = 600;  // [s]
constexpr double frames_per_second = 25, statuses_per_second = 10;

struct Frame {
  double t = 0;
  std::uint64_t step = 0;
  std::vector<BodySnapshot> bodies;
  std::array<float, 7> instrument{};
  std::vector<float> contacts;
  std::uint32_t removed = 0, aspirated = 0, status = 0;
  std::vector<BodyReport> compliance;
  SharedMessage operation;
};

Trajectory read(const std::string& file, const std::string& topic) {
  Trajectory t =
      is_bag(file) ? read_bag(file, topic, LengthUnit::metre) : read_trajectory(file, LengthUnit::metre);
  if (t.end() - t.begin() > longest)
    throw UsageError(file + ": lasts more than ten minutes: too long to keep each frame of it");
  return t;
}

class Source final : public SlotSource {
 public:
  explicit Source(const Trajectory& trajectory) : trajectory_(trajectory) {}
  DeviceCommand first() const noexcept override { return {sample_at(trajectory_, trajectory_.begin()), 0}; }
  DeviceCommand at(std::int64_t k, std::int64_t, const NewestForce&, bool) noexcept override {
    const double t = trajectory_.begin() + static_cast<double>(k) / 1e3;
    return {sample_at(trajectory_, t), buttons_at(trajectory_, t)};
  }
  std::int64_t slots() const {
    return 1 + static_cast<std::int64_t>(std::floor(1e3 * (trajectory_.end() - trajectory_.begin()) + 1e-6));
  }

 private:
  const Trajectory& trajectory_;
};

SharedMessage text(std::string key, const nlohmann::json& json) {
  return std::make_shared<const ViewMessage>(ViewMessage{std::move(key), false, json.dump()});
}

}  // namespace

struct Playback::State {
  const std::string name;
  const Scene scene;
  const Trajectory trajectory;
  const double duration;
  ViewScene view;

  std::mutex mutex;  // of what follows, until `now`
  std::vector<std::shared_ptr<const Frame>> frames;
  std::vector<float> force;  // 4 per block (health.h)
  double ready = 0;
  bool done = false;
  std::string failure;

  double now = 0, speed = 1;
  bool playing = true;
  std::vector<int> topology;  // per body, of the mesh that the view has
  std::int64_t last_ns = monotonic_ns();
  std::shared_ptr<const Frame> shown;
  double said_status = -1, said_ready = -1;
  bool news = true;  // of the timeline
  std::atomic<bool> stopping{false};
  std::thread thread;

  State(const std::string& recording, const std::string& topic, const std::string& scene_file)
      : name(std::filesystem::path(recording).filename().string()),
        scene(read_scene(scene_file)),
        trajectory(read(recording, topic)),
        duration(trajectory.end() - trajectory.begin()) {
    for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
      const SceneBody& body = scene.bodies[b];
      view.tell_body(static_cast<std::uint32_t>(b), body.name,
                     body.kind == BodyKind::deformable && body.simulated, body.mesh);
    }
    topology.assign(scene.bodies.size(), 0);
    const SceneInstrument& held = scene.first();
    view.tell_instrument(0, 1, {held.name, held.device.id, instrument_shape(held.shape)});
    thread = std::thread([this] { compute(); });
  }
  ~State() {
    stopping = true;
    thread.join();
  }

  // A cut, or a step back to before it, changes the mesh.
  void tell_topology(std::size_t b, const BodySnapshot& body) {
    if (body.topology == topology[b]) return;
    topology[b] = body.topology;
    TetMesh mesh = scene.bodies[b].mesh;
    std::vector<std::uint32_t> opened;
    if (body.topology > 0) {
      mesh = {};
      opened = body.opened;
      for (std::size_t i = 0; i + 2 < body.rest.size(); i += 3)
        mesh.nodes.push_back(Eigen::Map<const Eigen::Vector3f>(&body.rest[i]).cast<double>());
      for (std::size_t i = 0; i + 3 < body.tets.size(); i += 4)
        mesh.tets.push_back({static_cast<int>(body.tets[i]), static_cast<int>(body.tets[i + 1]),
                             static_cast<int>(body.tets[i + 2]), static_cast<int>(body.tets[i + 3])});
    }
    view.tell_body(static_cast<std::uint32_t>(b), scene.bodies[b].name, true, std::move(mesh),
                   std::move(opened));
  }

  struct Stopped {};

  void compute() {
    Source source(trajectory);
    const int every = std::max(1, static_cast<int>(scene.rate / frames_per_second));
    int steps = 0;
    std::uint32_t aspirated = 0;
    ForceBlocks blocks;
    std::uint64_t blocks_kept_here = 0;
    ReplaySinks sinks;
    std::optional<Operation> operation;
    sinks.step = [&](const ReplayedStep& step) {
      aspirated += static_cast<std::uint32_t>(step.report.fragments_aspirated);
      if (step.slot < 0) return;
      if (!operation) operation.emplace(step.world);
      operation->follow(step.world, step.report, step.samples, 1 / scene.rate);
      if (steps++ % every != 0) return;
      const std::shared_ptr<Frame> frame = frame_of(step, aspirated);
      frame->operation = operation_of(*operation);
      add(frame);
    };
    sinks.tick = [&](const ReplayedTick& tick) {
      if (stopping) throw Stopped{};
      if (tick.slot < 0) return;
      blocks.note(tick.record[0].force.force);
      if (blocks.count() == blocks_kept_here) return;
      blocks_kept_here = blocks.count();
      const std::vector<float> newest = blocks.newest();
      const std::lock_guard lock(mutex);
      force.insert(force.end(), newest.end() - 4, newest.end());
    };
    std::string why;
    try {
      if (!replay_offline(scene, {&source}, source.slots(), sinks)) why = "interrupted";
    } catch (const Stopped&) {
      return;
    } catch (const std::exception& e) {
      why = e.what();
    }
    const std::lock_guard lock(mutex);
    done = true;
    failure = why;
    if (why.empty()) ready = duration;
  }

  std::shared_ptr<Frame> frame_of(const ReplayedStep& step, std::uint32_t aspirated) const {
    auto frame = std::make_shared<Frame>();
    frame->t = 1e-3 * static_cast<double>(step.slot);
    frame->step = step.world.steps();
    for (const Body& body : step.world.bodies()) take_snapshot(body, frame->bodies.emplace_back());
    const ForceRecord& first = step.newest.record[0];
    const Pose& X = first.instrument.X;
    for (int i = 0; i < 3; ++i) frame->instrument[static_cast<std::size_t>(i)] = static_cast<float>(X.p[i]);
    for (int i = 0; i < 4; ++i)
      frame->instrument[static_cast<std::size_t>(3 + i)] = static_cast<float>(X.q.coeffs()[i]);
    for (const ContactForce& c : step.contacts) {
      for (const Vec3& v : {c.place, c.force})
        for (int i = 0; i < 3; ++i) frame->contacts.push_back(static_cast<float>(v[i]));
      frame->contacts.push_back(static_cast<float>(c.gap));
    }
    frame->removed = step.removed;
    frame->aspirated = aspirated;
    frame->status = first.force.status;
    frame->compliance = step.report.compliance;
    return frame;
  }
  // As a daemon would say it.
  SharedMessage operation_of(const Operation& operation) const {
    OperationMeasures measures;
    const std::uint64_t events = operation.newest(measures);
    std::vector<hapticd_msg_HandOperation> hands;
    std::vector<hapticd_msg_BodyOperation> bodies;
    return operation_text(
        operation_message(scene.first().device.id, scene.name, measures, events, hands, bodies));
  }
  void add(std::shared_ptr<const Frame> frame) {
    const std::lock_guard lock(mutex);
    ready = frame->t;
    frames.push_back(std::move(frame));
  }

  // The newest frame that is not after t; null: none yet.
  std::shared_ptr<const Frame> at(double t) {
    const std::lock_guard lock(mutex);
    if (frames.empty()) return nullptr;
    const auto after = std::upper_bound(frames.begin(), frames.end(), t,
                                        [](double value, const auto& frame) { return value < frame->t; });
    return after == frames.begin() ? frames.front() : *(after - 1);
  }

  void show(const Frame& frame) {
    for (std::size_t b = 0; b < frame.bodies.size(); ++b)
      if (!frame.bodies[b].nodes.empty()) {
        tell_topology(b, frame.bodies[b]);
        view.tell_motion(static_cast<std::uint32_t>(b), frame.t, frame.bodies[b].nodes,
                         frame.bodies[b].alive);
      }
    view.tell_contacts(frame.t, frame.instrument, frame.contacts, {});
  }

  // As a daemon would say it; what belongs to a machine's clock is left out.
  SharedMessage status_of(const Frame& frame) const {
    return text("status", {{"kind", "status"},
                           {"daemon", true},
                           {"devices",
                            {{{"id", scene.first().device.id},
                              {"scene", scene.name},
                              {"step", frame.step},
                              {"removed", frame.removed},
                              {"aspirated", frame.aspirated},
                              {"status", frame.status},
                              {"refused", ""}}}}});
  }
  SharedMessage health_of(const Frame& frame) {
    nlohmann::json bodies = nlohmann::json::array();
    for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
      if (frame.bodies[b].nodes.empty()) continue;
      nlohmann::json body{{"body", b}, {"awake", false}, {"degraded", false}};
      for (const BodyReport& r : frame.compliance)
        if (r.body == static_cast<int>(b))
          body = {{"body", b},
                  {"awake", true},
                  {"degraded", r.compliance.health == ComplianceHealth::degraded},
                  {"reference_age", r.compliance.reference_age},
                  {"removed", r.compliance.removed_since_reference},
                  {"error", r.compliance.error}};
      bodies.push_back(body);
    }
    nlohmann::json newest = nlohmann::json::array();
    const std::lock_guard lock(mutex);
    const std::size_t end = std::min(static_cast<std::size_t>(std::max(0.0, 100 * now)), force.size() / 4);
    for (std::size_t i = 4 * (end > blocks_kept ? end - blocks_kept : 0); i < 4 * end; ++i)
      newest.push_back(force[i]);
    const DeviceSettings& d = scene.first().device;
    return text("health/0",
                {{"kind", "health"},
                 {"id", d.id},
                 {"device", scene.first().device_name},
                 {"compliance", compliance_name(scene.compliance)},
                 {"blocks", end},
                 {"force", newest},
                 {"period_ms", 1e3 / scene.rate},
                 {"bodies", bodies},
                 {"max_force", d.max_force},
                 {"workspace", d.workspace_radius},
                 {"position_scale", d.position_scale},
                 {"force_scale", d.force_scale},
                 {"origin", std::vector<double>(d.origin.data(), d.origin.data() + 3)},
                 {"frame", std::vector<double>(d.frame.coeffs().data(), d.frame.coeffs().data() + 4)},
                 {"tool", std::vector<double>(d.tool.coeffs().data(), d.tool.coeffs().data() + 4)}});
  }
};

Playback::Playback(const std::string& recording, const std::string& topic, const std::string& scene)
    : state_(std::make_unique<State>(recording, topic, scene)) {}

Playback::~Playback() = default;

bool Playback::failed() const {
  const std::lock_guard lock(state_->mutex);
  return !state_->failure.empty() && state_->failure != "interrupted";
}

void Playback::hear(const std::string& said) {
  const nlohmann::json json = nlohmann::json::parse(said, nullptr, false);
  if (!json.is_object() || !json.contains("timeline") || !json["timeline"].is_object()) return;
  State& s = *state_;
  try {
    const nlohmann::json& timeline = json["timeline"];
    if (timeline.contains("seek")) {
      const double t = timeline["seek"].get<double>();
      if (std::isfinite(t)) s.now = std::clamp(t, 0.0, s.duration);
    }
    if (timeline.contains("speed")) {
      const double speed = timeline["speed"].get<double>();
      if (std::isfinite(speed)) s.speed = std::clamp(speed, 0.05, 10.0);
    }
    if (timeline.contains("playing")) {
      s.playing = timeline["playing"].get<bool>();
      // Played to its end, it begins anew.
      if (s.playing && s.now >= s.duration) s.now = 0;
    }
    s.news = true;
  } catch (const nlohmann::json::exception&) {
    // Not a text of ours.
  }
}

std::vector<SharedMessage> Playback::poll() {
  State& s = *state_;
  const std::int64_t now_ns = monotonic_ns();
  const double dt = 1e-9 * static_cast<double>(now_ns - std::exchange(s.last_ns, now_ns));
  double ready = 0;
  bool done = false;
  std::string failure;
  {
    const std::lock_guard lock(s.mutex);
    ready = s.ready;
    done = s.done;
    failure = s.failure;
  }
  const double before = s.now;
  if (s.playing) s.now = std::min(s.now + s.speed * dt, std::max(ready, s.now));
  if (s.playing && done && s.now >= ready) {
    s.playing = false;
    s.news = true;
  }
  const std::shared_ptr<const Frame> frame = s.at(s.now);
  if (frame && frame != s.shown) s.show(*frame);
  const bool moved = frame != s.shown;
  s.shown = frame;
  std::vector<SharedMessage> out = s.view.messages();
  const bool due = std::abs(s.now - s.said_status) >= 1 / statuses_per_second || (s.news && moved);
  if (frame && (due || s.now < before)) {
    s.said_status = s.now;
    out.push_back(s.status_of(*frame));
    out.push_back(s.health_of(*frame));
    out.push_back(frame->operation);
    s.news = true;
  }
  if (s.news || std::abs(ready - s.said_ready) > 0.5) {
    s.news = false;
    s.said_ready = ready;
    out.push_back(text("timeline", {{"kind", "timeline"},
                                    {"name", s.name},
                                    {"t", s.now},
                                    {"duration", s.duration},
                                    {"ready", ready},
                                    {"playing", s.playing},
                                    {"speed", s.speed},
                                    {"done", done},
                                    {"failure", failure}}));
  }
  return out;
}

}  // namespace hapticd
