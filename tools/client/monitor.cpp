#include "tools/client/monitor.h"

#include <algorithm>
#include <cstdio>
#include <stdexcept>

#include "haptic/clock.h"
#include "tools/cli/report.h"
#include "tools/record/surface_file.h"

namespace hapticd {
namespace {

std::vector<Vec3> points(const float* xyz, std::uint32_t length) {
  std::vector<Vec3> result;
  for (std::uint32_t i = 0; i + 2 < length; i += 3) result.emplace_back(xyz[i], xyz[i + 1], xyz[i + 2]);
  return result;
}

}  // namespace

Monitor::Monitor(const Participant& participant, std::uint32_t device_id)
    : device_id_(device_id), status_(participant), geometry_(participant), update_(participant) {}

void Monitor::poll() {
  status_.take_each([this](const hapticd_msg_ServerStatus& m, const dds_sample_info_t&) {
    if (m.device_id != device_id_) return;
    statuses_.push_back({monotonic_ns(), m.elements_removed, m.fragments_aspirated, m.haptic_rate_hz,
                         m.sim_rate_hz, m.samples, m.samples_dropped, m.scene ? m.scene : ""});
  });
  geometry_.take_each([this](const hapticd_msg_SceneGeometry& m, const dds_sample_info_t&) {
    Body& body = bodies_[m.body];
    body.name = m.name;
    TetMesh& mesh = body.geometry.mesh;
    mesh.nodes = points(m.nodes._buffer, m.nodes._length);
    mesh.tets.clear();
    for (std::uint32_t i = 0; i + 3 < m.tets._length; i += 4) {
      const std::uint32_t* t = m.tets._buffer + i;
      mesh.tets.push_back({int(t[0]), int(t[1]), int(t[2]), int(t[3])});
    }
    body.geometry.opened.assign(m.opened._buffer, m.opened._buffer + m.opened._length);
    if (body.first.nodes.empty()) body.first_geometry = body.geometry;
  });
  update_.take_each([this](const hapticd_msg_SceneUpdate& m, const dds_sample_info_t&) {
    Body& body = bodies_[m.body];
    body.newest.nodes = points(m.nodes._buffer, m.nodes._length);
    body.newest.alive.assign(m.alive._buffer, m.alive._buffer + m.alive._length);
    if (body.first.nodes.empty()) body.first = body.newest;
  });
}

void Monitor::poll_at(double time) {
  poll();
  for (; next_kept_ < keep_at_.size() && time >= keep_at_[next_kept_]; ++next_kept_) {
    char when[32];
    std::snprintf(when, sizeof when, "at_%03.0f", keep_at_[next_kept_]);
    for (auto& [id, body] : bodies_) body.kept[when] = {body.geometry, body.newest};
  }
}

StatusRecord Monitor::at(std::int64_t time_ns) const {
  const auto after = std::upper_bound(statuses_.begin(), statuses_.end(), time_ns,
                                      [](std::int64_t t, const StatusRecord& s) { return t < s.arrived_ns; });
  return after == statuses_.begin() ? StatusRecord{} : *(after - 1);
}

std::vector<std::filesystem::path> Monitor::write_surfaces(const std::filesystem::path& directory) const {
  std::vector<std::filesystem::path> files;
  for (const auto& [id, body] : bodies_) {
    if (body.geometry.mesh.tets.empty()) continue;
    const auto write = [&, &name = body.name](const std::string& when, const Geometry& geometry,
                                              const State& state) {
      const TetMesh& mesh = geometry.mesh;
      const bool moves = state.nodes.size() == mesh.nodes.size();
      const DisplaySurface surface = display_surface(
          mesh, moves ? state.nodes : mesh.nodes,
          moves ? std::span<const std::uint8_t>(state.alive) : std::span<const std::uint8_t>(),
          geometry.opened);
      files.push_back(directory / (as_file_name(name) + "_" + when + ".vtk"));
      write_file(files.back().string(), to_vtk(surface, name + " " + when + ", metres"));
    };
    write("before", body.first_geometry, body.first);
    for (const auto& [when, kept] : body.kept) write(when, kept.first, kept.second);
    write("after", body.geometry, body.newest);
  }
  if (files.empty())
    throw std::runtime_error("the daemon published no scene geometry: no surface can be written");
  return files;
}

}  // namespace hapticd
