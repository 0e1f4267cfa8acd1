#include "server/observe/health.h"

#include <algorithm>
#include <cmath>

#include "server/dds/borrowed.h"
#include "server/scene/scene_describe.h"

namespace hapticd {
namespace {

// Of histogram.h: 64 bins an octave, the first 64 bins of 1 ns.
constexpr int fine_per_bin = 16, first_fine = 64 * (10 - 5);

// Null: a further device's, with a world of its own.
const SceneInstrument* held_by(const Scene& scene, std::uint32_t id) {
  for (const SceneInstrument& i : scene.instruments)
    if (i.device.id == id) return &i;
  return nullptr;
}

const DeviceSettings& device_of(const Scene& scene, std::uint32_t id) {
  if (const SceneInstrument* held = held_by(scene, id)) return held->device;
  for (const DeviceSettings& d : scene.more_devices)
    if (d.id == id) return d;
  return scene.first().device;
}

std::string name_of(const Scene& scene, std::uint32_t id) {
  const SceneInstrument* held = held_by(scene, id);
  return held ? held->device_name : "";
}

}  // namespace

std::vector<std::uint32_t> health_counts(const HistogramSnapshot& histogram) {
  std::vector<std::uint32_t> out(health_bins, 0);
  for (int i = 0; i < histogram_bins; ++i) {
    const int bin = i < first_fine ? 0 : std::min(1 + (i - first_fine) / fine_per_bin, health_bins - 1);
    out[static_cast<std::size_t>(bin)] +=
        static_cast<std::uint32_t>(histogram.bin[static_cast<std::size_t>(i)]);
  }
  return out;
}

double health_quantile_ns(const std::vector<std::uint32_t>& counts, double q) {
  std::uint64_t all = 0, below = 0;
  for (std::uint32_t n : counts) all += n;
  if (all == 0) return std::nan("");
  std::size_t bin = 0;
  for (; bin + 1 < counts.size(); ++bin)
    if (static_cast<double>(below += counts[bin]) >= q * static_cast<double>(all)) break;
  return std::ldexp(1 + 0.25 * static_cast<double>(bin % 4), 10 + static_cast<int>(bin / 4));
}

void ForceBlocks::note(const Vec3& force) {
  sum_ += force;
  largest_ = std::max(largest_, force.norm());
  if (++ticks_ < ticks_per_block) return;
  std::array<float, 4>& block = block_[count_++ % blocks_kept];
  for (int i = 0; i < 3; ++i)
    block[static_cast<std::size_t>(i)] = static_cast<float>(sum_[i] / static_cast<double>(ticks_per_block));
  block[3] = static_cast<float>(largest_);
  sum_.setZero();
  largest_ = 0;
  ticks_ = 0;
}

std::vector<float> ForceBlocks::newest() const {
  std::vector<float> out;
  for (std::uint64_t i = count_ > blocks_kept ? count_ - blocks_kept : 0; i < count_; ++i)
    out.insert(out.end(), block_[i % blocks_kept].begin(), block_[i % blocks_kept].end());
  return out;
}

HealthPublisher::HealthPublisher(const Participant& participant, const Scene& scene, std::uint32_t device_id)
    : scene_(&scene),
      device_id_(device_id),
      device_(device_of(scene, device_id)),
      name_(name_of(scene, device_id)),
      writer_(participant) {}

void HealthPublisher::show(const Scene& scene) {
  scene_ = &scene;
  device_ = device_of(scene, device_id_);
  name_ = name_of(scene, device_id_);
  last_ = {};
}

void HealthPublisher::note(const ForceRecord& record) {
  force_.note(record.force.force);
  energy_ = record.force.energy;
  energy_least_ = std::min(energy_least_, energy_);
}

void HealthPublisher::publish(const HistogramSnapshot& wake, const HistogramSnapshot& solve,
                              const StepHealth& step) {
  std::vector<float> force = force_.newest();
  std::vector<std::uint32_t> wakes = health_counts(wake), solves = health_counts(solve);
  std::vector<hapticd_msg_BodyHealth> bodies;
  for (std::size_t b = 0; b < scene_->bodies.size(); ++b) {
    if (scene_->bodies[b].kind != BodyKind::deformable || !scene_->bodies[b].simulated) continue;
    hapticd_msg_BodyHealth& out = bodies.emplace_back();
    out = {};
    out.body = static_cast<std::uint32_t>(b);
    for (const BodyReport& r : step.bodies) {
      if (r.body != static_cast<int>(b)) continue;
      out.awake = true;
      out.degraded = r.compliance.health == ComplianceHealth::degraded;
      out.reference_age = static_cast<std::uint32_t>(r.compliance.reference_age);
      out.removed_since_reference = static_cast<std::uint32_t>(r.compliance.removed_since_reference);
      out.error = static_cast<float>(r.compliance.error);
    }
  }
  hapticd_msg_ServerHealth m{};
  m.device_id = device_.id;
  m.device = name_.data();
  std::string method(compliance_name(scene_->compliance));
  m.compliance = method.data();
  m.blocks = force_.count();
  m.force = borrowed<decltype(m.force)>(force);
  m.wake = borrowed<decltype(m.wake)>(wakes);
  m.solve = borrowed<decltype(m.solve)>(solves);
  m.energy = energy_;
  m.energy_least = energy_least_;
  if (step.step > last_.step)
    for (std::size_t p = 0; p < step_parts; ++p)
      m.step_part_ms[p] = static_cast<float>(1e-6 * static_cast<double>(step.part_ns[p] - last_.part_ns[p]) /
                                             static_cast<double>(step.step - last_.step));
  last_ = step;
  m.step_period_ms = static_cast<float>(1e3 / scene_->rate);
  m.bodies = borrowed<decltype(m.bodies)>(bodies);
  m.max_force = static_cast<float>(device_.max_force);
  m.max_speed = static_cast<float>(device_.max_speed);
  m.workspace_radius = static_cast<float>(device_.workspace_radius);
  m.position_scale = static_cast<float>(device_.position_scale);
  m.force_scale = static_cast<float>(device_.force_scale);
  for (int i = 0; i < 3; ++i) m.origin[i] = static_cast<float>(device_.origin[i]);
  for (int i = 0; i < 4; ++i) {
    m.frame[i] = static_cast<float>(device_.frame.coeffs()[i]);
    m.tool[i] = static_cast<float>(device_.tool.coeffs()[i]);
  }
  writer_.write(m);
}

}  // namespace hapticd
