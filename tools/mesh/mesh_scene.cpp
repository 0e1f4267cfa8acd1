#include "tools/mesh/mesh_scene.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <set>

namespace hapticd {
namespace {

constexpr double young = 3e3, poisson = 0.45, density = 1000;
constexpr double device_stiffness = 400,
                 device_reach = 0.06;  // of a VertexFaceContact: N/m, and the hand's usual travel [m]
constexpr double lowest_part = 0.1;
constexpr double most_fixed = 0.5;  // of the boundary's nodes: a group that holds more is not a support

[[gnu::format(printf, 1, 2)]] std::string format(const char* text, ...) {
  char line[512];
  va_list arguments;
  va_start(arguments, text);
  std::vsnprintf(line, sizeof line, text, arguments);
  va_end(arguments);
  return line;
}

bool names_a_support(std::string name) {
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  for (const char* word : {"fix", "bottom", "base", "support", "rim", "zonule", "dirichlet", "clamp", "wall"})
    if (name.find(word) != std::string::npos) return true;
  return false;
}

bool holds_every_piece(const TetMesh& mesh, const MeshGroup& group, const std::vector<int>& piece) {
  std::set<int> held;
  for (const int n : group.nodes) held.insert(piece[n]);
  return held.size() == std::set<int>(piece.begin(), piece.end()).size() &&
         group.nodes.size() < mesh.nodes.size();
}

// At most so high is held in each piece, where a group is made here.
std::vector<int> lowest_nodes(const TetMesh& mesh) {
  const std::vector<int> piece = pieces_of(mesh);
  std::vector<double> low(mesh.nodes.size(), 1e300), high(mesh.nodes.size(), -1e300);
  for (std::size_t n = 0; n < mesh.nodes.size(); ++n) {
    low[piece[n]] = std::min(low[piece[n]], mesh.nodes[n].z());
    high[piece[n]] = std::max(high[piece[n]], mesh.nodes[n].z());
  }
  std::vector<int> nodes;
  for (std::size_t n = 0; n < mesh.nodes.size(); ++n) {
    const int p = piece[n];
    if (mesh.nodes[n].z() <= low[p] + lowest_part * (high[p] - low[p])) nodes.push_back(static_cast<int>(n));
  }
  return nodes;
}

}  // namespace

SceneDefaults scene_defaults(const TetMesh& mesh, const MeshQuality& q) {
  SceneDefaults d;
  const std::vector<int> piece = pieces_of(mesh);
  for (const MeshGroup& g : mesh.groups)
    if (d.fixed.empty() && g.tets.empty() && names_a_support(g.name) && holds_every_piece(mesh, g, piece) &&
        static_cast<double>(g.nodes.size()) < most_fixed * q.boundary_nodes)
      d.fixed = g.name;
  d.fixed_is_new = d.fixed.empty();
  if (d.fixed_is_new) {
    d.fixed = "held_below";
    while (mesh.group(d.fixed)) d.fixed += '_';
  }
  const double D = q.diagonal(), edge = q.surface_edge.mean;
  d.tip_radius = std::clamp(2 * edge, D / 30, D / 8);
  d.alarm_distance = 1.6 * d.tip_radius;
  d.sample_spacing = d.tip_radius / 3;
  d.coupling = 20 * young / (1 - poisson * poisson) * std::sqrt(0.5) * d.tip_radius;
  d.rotational_coupling = d.coupling * std::pow(3 * d.tip_radius, 2);
  d.position_scale = 0.3 * D / device_reach;
  d.force_scale = device_stiffness / (d.coupling * d.position_scale);
  d.origin = {0.5 * (q.low.x() + q.high.x()), 0.5 * (q.low.y() + q.high.y()), q.high.z() + d.tip_radius};

  d.reasons = {
      d.fixed_is_new ? format("fixed: the lowest tenth along z (no group of the mesh names a support): %s",
                              d.fixed.c_str())
                     : format("fixed: %s, by its name, and it holds every piece", d.fixed.c_str()),
      format("material: a soft organ's, E %.3g Pa, nu %.3g, %.4g kg/m3: put your own", young, poisson,
             density),
      format("tip: sphere of %.3g mm radius, twice the surface's mean edge (%.3g mm) within a 30th and an "
             "8th of "
             "the diagonal (%.3g mm)",
             1e3 * d.tip_radius, 1e3 * edge, 1e3 * D),
      format(
          "alarm distance %.3g mm: what the tip may move in a step, 1.6 radii; samples a third of a radius "
          "apart",
          1e3 * d.alarm_distance),
      format("coupling %.4g N/m: ten times Hertz's contact stiffness half a radius deep", d.coupling),
      format("scales: 60 mm of the hand are 0.3 diagonals; the coupling feels like the %.0f N/m a Touch "
             "displays",
             device_stiffness)};
  return d;
}

void add_fixed_group(TetMesh& mesh, const SceneDefaults& d) {
  if (d.fixed_is_new) mesh.groups.push_back({d.fixed, lowest_nodes(mesh), {}});
}

std::string scene_text(const SceneDefaults& d, const std::string& name, const std::string& mesh_file) {
  std::string out = "# Made by `haptic mesh`. What was chosen and why:\n";
  for (const std::string& reason : d.reasons) out += "# - " + reason + '\n';
  out += format(
      "scene: %s\n\nmodel: auto    # the least model within `accuracy`; `hapticd --check` says which\n"
      "accuracy: 0.02  # of the peak force\n\n",
      name.c_str());
  out += format(
      "simulation:\n  rate: 50\n  contact: renewed  # each haptic tick: frozen for a step the force would "
      "jump 50 times a second\n  alarm_distance: %.6g\n  sample_spacing: %.6g\n\n",
      d.alarm_distance, d.sample_spacing);
  out += format(
      "bodies:\n  - name: tissue\n    kind: deformable\n    mesh: %s\n    fixed: %s\n"
      "    removable: true\n    material: {young: %.6g, poisson: %.6g, density: %.6g, rayleigh: {mass: 2, "
      "stiffness: 2.0e-3}}\n\n",
      mesh_file.c_str(), d.fixed.c_str(), young, poisson, density);
  const double r = d.tip_radius;
  out += format(
      "instrument:\n  tip: tip\n  primitives:\n    - {name: tip, shape: sphere, radius: %.6g}\n"
      "    - {name: needle, shape: capsule, radius: %.6g, from: [0, 0, 0], to: [0, 0, %.6g]}\n",
      r, 0.9 * r, 24 * r);
  out += format("  coupling: {stiffness: %.6g, rotational_stiffness: %.6g, damping_time: 2.0e-3}\n\n",
                d.coupling, d.rotational_coupling);
  out += format("removal: {rate: 30, stroke: %.6g}\n\ndevice: touch\n\n", 0.2 * r);
  out += format("mapping: {position_scale: %.6g, force_scale: %.6g, origin: [%.6g, %.6g, %.6g]}\n",
                d.position_scale, d.force_scale, d.origin.x(), d.origin.y(), d.origin.z());
  return out;
}

}  // namespace hapticd
