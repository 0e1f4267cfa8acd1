#include "tools/record/scene_frames.h"

#include "haptic/clock.h"
#include "tools/record/instrument_surface.h"

namespace hapticd {
namespace {

std::vector<Vec3> points(const float* xyz, std::uint32_t length) {
  std::vector<Vec3> result;
  for (std::uint32_t i = 0; i + 2 < length; i += 3) result.emplace_back(xyz[i], xyz[i + 1], xyz[i + 2]);
  return result;
}

Pose pose_at(const float* x) { return {{x[0], x[1], x[2]}, Quat(x[6], x[3], x[4], x[5]).normalized()}; }

VtkContact contact_of(const hapticd_msg_SceneUpdate& m) {
  constexpr std::uint32_t size = 7;
  VtkContact out;
  for (std::uint32_t i = 0; i + size <= m.instruments._length; i += size)
    out.instruments.push_back({pose_at(m.instruments._buffer + i), Vec3::Zero(), {}});
  for (std::uint32_t i = 0; i < m.contacts._length / size; ++i) {
    const float* c = m.contacts._buffer + size * i;
    ContactForce of{{c[0], c[1], c[2]}, {c[3], c[4], c[5]}, c[6]};
    if (2 * i + 1 < m.pressing._length) {
      of.instrument = m.pressing._buffer[2 * i];
      const std::uint8_t other = m.pressing._buffer[2 * i + 1];
      of.other = other == pressed_tissue ? -1 : other;
    }
    const auto feels = [&out](int instrument, const Vec3& force) {
      if (instrument >= 0 && static_cast<std::size_t>(instrument) < out.instruments.size())
        out.instruments[static_cast<std::size_t>(instrument)].force += force;
    };
    feels(of.instrument, -of.force);
    feels(of.other, of.force);
    out.contacts.push_back(of);
  }
  return out;
}

}  // namespace

SceneFrames::SceneFrames(const Participant& participant, const std::filesystem::path& directory)
    : geometry_(participant), update_(participant), instrument_(participant), series_(directory) {}

void SceneFrames::poll() {
  geometry_.take_each([this](const hapticd_msg_SceneGeometry& m, const dds_sample_info_t&) {
    Body& body = bodies_[m.body];
    body.name = m.name;
    body.mesh.nodes = points(m.nodes._buffer, m.nodes._length);
    body.mesh.tets.clear();
    for (std::uint32_t i = 0; i + 3 < m.tets._length; i += 4) {
      const std::uint32_t* t = m.tets._buffer + i;
      body.mesh.tets.push_back({int(t[0]), int(t[1]), int(t[2]), int(t[3])});
    }
  });
  instrument_.take_each([this](const hapticd_msg_SceneInstrument& m, const dds_sample_info_t&) {
    surfaces_[m.instrument] = instrument_surface({m.primitives._buffer, m.primitives._length});
  });
  update_.take_each([this](const hapticd_msg_SceneUpdate& m, const dds_sample_info_t&) {
    Body& body = bodies_[m.body];
    body.nodes = points(m.nodes._buffer, m.nodes._length);
    body.alive.assign(body.mesh.tets.size(), 1);
    for (std::size_t e = 0; e < body.alive.size() && e / 8 < m.alive._length; ++e)
      body.alive[e] = m.alive._buffer[e / 8] >> (e % 8) & 1;
    contact_ = contact_of(m);
    step_ = m.step;
  });
  if (step_ == written_ || bodies_.empty()) return;
  written_ = step_;
  const std::int64_t now = monotonic_ns();
  if (first_ns_ == 0) first_ns_ = now;
  std::vector<VtkBody> bodies;
  for (const auto& [id, body] : bodies_) {
    // An update may come before its geometry.
    const bool moves = body.nodes.size() == body.mesh.nodes.size();
    bodies.push_back(
        {body.name, &body.mesh, moves ? std::span<const Vec3>(body.nodes) : std::span<const Vec3>(),
         moves ? std::span<const std::uint8_t>(body.alive) : std::span<const std::uint8_t>(), 0});
  }
  for (std::size_t i = 0; i < contact_.instruments.size(); ++i)
    if (const auto found = surfaces_.find(static_cast<std::uint32_t>(i)); found != surfaces_.end())
      contact_.instruments[i].surface = found->second;
  series_.add(1e-9 * static_cast<double>(now - first_ns_), bodies, contact_);
}

}  // namespace hapticd
