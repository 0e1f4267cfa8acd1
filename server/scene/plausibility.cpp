#include "server/scene/plausibility.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "physics/tissue/mesh_quality.h"
#include "physics/tissue/surface.h"
#include "server/files/format.h"
#include "server/mesh/mesh_unit.h"

namespace hapticd {
namespace {

constexpr double softest = 50, stiffest = 1e7;    // [Pa]
constexpr double smallest = 1e-3, largest = 1;    // [m]
constexpr double reach_in_alarm_distances = 1.6;  // of a zone (simulation/world.cpp)
constexpr double least_coupling = 3;              // times the contact's stiffness

// 0: the tip has none.
double tip_radius(const SceneInstrument& held) {
  const Primitive& tip = held.shape.primitives[static_cast<std::size_t>(held.shape.tip)];
  return tip.shape == Shape::convex ? 0 : tip.radius;
}

void doubt_body(const Scene& scene, const SceneBody& body, std::vector<std::string>& out) {
  const MeshQuality q = measure_mesh(body.mesh);
  const char* name = body.name.c_str();
  const std::string unit = unit_question(q.diagonal());
  if (q.diagonal() > largest)
    out.push_back(
        format("%s: %.3g m from corner to corner: larger than an organ%s", name, q.diagonal(), unit.c_str()));
  if (q.diagonal() < smallest)
    out.push_back(format("%s: %.3g mm from corner to corner: smaller than an organ%s", name,
                         1e3 * q.diagonal(),
                         unit.empty() ? "; is its unit right (mesh_unit, scale)?" : unit.c_str()));
  if (body.kind == BodyKind::rigid) return;
  if (body.material.young < softest || body.material.young > stiffest)
    out.push_back(format("%s: E %.3g Pa: soft tissue has 50 Pa to 10 MPa, an organ some kPa (3e3)", name,
                         body.material.young));
  for (const SceneInstrument& held : scene.instruments) {
    const double r = tip_radius(held);
    if (!(r > 0)) continue;
    if (r < 0.5 * q.surface_edge.mean)
      out.push_back(format(
          "%s: the tip of %s (%.3g mm) is finer than the mesh (edges of %.3g mm): elements are felt, not "
          "tissue",
          name, held.name.c_str(), 1e3 * r, 1e3 * q.surface_edge.mean));
    if (r > 0.5 * q.diagonal())
      out.push_back(format("%s: the tip of %s (%.3g mm) is as large as the body (%.3g mm)", name,
                           held.name.c_str(), 1e3 * r, 1e3 * q.diagonal()));
    const double contact = 2 * body.material.young / (1 - body.material.poisson * body.material.poisson) * r *
                           std::numbers::sqrt2 / 2;
    if (held.coupling.stiffness < least_coupling * contact)
      out.push_back(format(
          "%s: the coupling of %s (%.3g N/m) is hardly stiffer than the tissue under its tip (%.3g N/m): "
          "that is what is felt",
          name, held.name.c_str(), held.coupling.stiffness, contact));
    const std::vector<int> near = nodes_in_reach(body.mesh, r, scene.alarm_distance);
    if (!near.empty() && near.back() > max_patch_nodes)
      out.push_back(format(
          "%s: up to %d nodes are within reach of the tip, and a problem holds %d: the farthest are left "
          "out (a coarser mesh, or a smaller alarm_distance)",
          name, near.back(), max_patch_nodes));
  }
  const double face = q.boundary_faces > 0 ? q.boundary_area / q.boundary_faces : 0;
  for (const SceneInstrument& held : scene.instruments) {
    const double reach = tip_radius(held) + scene.alarm_distance;
    const double samples = std::numbers::pi * reach * reach /
                           std::max(1e-300, std::min(scene.sample_spacing * scene.sample_spacing, face));
    if (samples > max_patch_samples)
      out.push_back(format(
          "%s: some %.0f sample points are within reach of %s, and a problem holds %d: the nearest are kept "
          "(a larger sample_spacing)",
          name, samples, held.name.c_str(), max_patch_samples));
  }
}

}  // namespace

std::string unit_question(double diagonal) {
  const std::string unit = likely_unit(diagonal);
  return unit.empty() ? "" : "; is the mesh in " + unit + " (mesh_unit: " + unit + ")?";
}

std::vector<int> nodes_in_reach(const TetMesh& mesh, double tip_radius, double alarm_distance) {
  constexpr std::size_t places = 64;
  const double reach = tip_radius + reach_in_alarm_distances * alarm_distance;
  const BoundarySurface surface(mesh);
  std::vector<int> sizes;
  const std::size_t every = std::max<std::size_t>(1, surface.faces().size() / places);
  for (std::size_t f = 0; f < surface.faces().size(); f += every) {
    const Triangle& t = surface.faces()[f].nodes;
    const Vec3 &a = mesh.nodes[t[0]], &b = mesh.nodes[t[1]], &c = mesh.nodes[t[2]];
    const Vec3 tip = (a + b + c) / 3 + tip_radius * (b - a).cross(c - a).stableNormalized();
    int size = 0;
    for (const Vec3& x : mesh.nodes) size += (x - tip).norm() < reach;
    sizes.push_back(size);
  }
  std::sort(sizes.begin(), sizes.end());
  return sizes;
}

std::vector<std::string> doubts(const Scene& scene) {
  std::vector<std::string> out;
  for (const SceneBody& body : scene.bodies) doubt_body(scene, body, out);
  return out;
}

}  // namespace hapticd
