#include "tools/mesh/mesh_scene.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <set>
#include <vector>

#include <yaml-cpp/yaml.h>

#include "physics/contact/cutting/edge_sample.h"
#include "server/files/format.h"

namespace hapticd {
namespace {

constexpr double young = 3e3, poisson = 0.45, density = 1000;
constexpr double device_stiffness = 400,
                 device_reach = 0.06;  // of a Touch: N/m, and the hand's usual travel [m]
constexpr double lowest_part = 0.1;
constexpr double blade_radii = 2.5, samples_per_edge = 3,
                 nodes_per_cut = 4;  // … nodes per area of an edge squared
constexpr double most_fixed = 0.5;   // of the boundary's nodes: a group that holds more is not a support

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

void write_tip(YAML::Emitter& out, double r) {
  using namespace YAML;
  const auto key = [&](const char* text) -> Emitter& { return out << Key << text << Value; };
  key("tip") << "tip";
  key("primitives") << BeginSeq << Flow << BeginMap;
  key("name") << "tip";
  key("shape") << "sphere";
  key("radius") << r;
  out << EndMap << Flow << BeginMap;
  key("name") << "needle";
  key("shape") << "capsule";
  key("radius") << 0.9 * r;
  key("from") << Flow << std::vector<double>{0, 0, 0};
  key("to") << Flow << std::vector<double>{0, 0, 24 * r};
  out << EndMap << EndSeq;
}

void write_blade(YAML::Emitter& out, const SceneDefaults& d) {
  using namespace YAML;
  const auto key = [&](const char* text) -> Emitter& { return out << Key << text << Value; };
  const double near = -2 * d.mean_edge, far = near - d.blade, half = 0.03 * d.mean_edge;
  // Ground to nothing in front and below, over an edge: a blunt front would push what a cut leaves beside the
  // blade's way.
  std::vector<std::vector<double>> corners = {{near, 0, 0}, {near, 0, d.blade}, {far, 0, 0}};
  for (const double z : {std::min(d.mean_edge, 0.5 * d.blade), d.blade})
    for (const double x : {far, near - d.mean_edge})
      for (const double y : {-half, half}) corners.push_back({x, y, z});
  key("tip") << "sheet";
  key("primitives") << Comment("behind the edge: both of its sides touch tissue") << BeginSeq << BeginMap;
  key("name") << "sheet";
  key("shape") << "convex";
  key("points") << Flow << corners;
  out << EndMap << EndSeq;
  key("blade") << BeginMap;
  key("edge") << Flow << std::vector<std::vector<double>>{{0, 0, 0}, {0, 0, d.blade}};
  key("direction") << Flow << std::vector<double>{1, 0, 0};
  key("samples") << std::clamp(static_cast<int>(std::lround(samples_per_edge * d.blade / d.mean_edge)), 4,
                               max_edge_samples);
  out << EndMap;
}

}  // namespace

SceneDefaults scene_defaults(const TetMesh& mesh, const MeshQuality& q, bool blade) {
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
  if (!blade) return d;
  d.blade = blade_radii * d.tip_radius;
  d.mean_edge = q.edge.mean;
  d.toughness = young * q.edge.mean;
  d.max_new_nodes = static_cast<int>(std::ceil(nodes_per_cut * 0.25 * D * D / (q.edge.mean * q.edge.mean)));
  d.reasons.push_back(format(
      "blade: an upright edge of %.3g mm, two and a half of the tip's radii, that cuts along x; toughness "
      "%.3g J/m2: it yields a mean edge (%.3g mm) deep: put your own",
      1e3 * d.blade, d.toughness, 1e3 * q.edge.mean));
  d.reasons.push_back(format("room for %d new nodes: %.3g mm2 of cuts, a quarter of the squared diagonal",
                             d.max_new_nodes, 1e6 * 0.25 * D * D));
  return d;
}

void add_fixed_group(TetMesh& mesh, const SceneDefaults& d) {
  if (d.fixed_is_new) mesh.groups.push_back({d.fixed, lowest_nodes(mesh), {}});
}

std::string scene_text(const SceneDefaults& d, const std::string& name, const std::string& mesh_file) {
  using namespace YAML;
  const double r = d.tip_radius;
  Emitter out;
  out.SetDoublePrecision(6);
  std::string reasons = "Made by `haptic mesh`. What was chosen and why:";
  for (const std::string& reason : d.reasons) reasons += "\n- " + reason;
  out << Comment(reasons) << Newline << BeginMap;
  const auto key = [&](const char* text) -> Emitter& { return out << Key << text << Value; };
  key("scene") << name << Newline;
  key("model") << "auto" << Comment("the least model within `accuracy`; `hapticd --check` says which");
  key("accuracy") << 0.02 << Comment("of the peak force") << Newline;

  key("simulation") << BeginMap;
  key("rate") << 50;
  key("contact") << "renewed"
                 << Comment("each haptic tick: frozen for a step the force would jump 50 times a second");
  key("alarm_distance") << d.alarm_distance;
  key("sample_spacing") << d.sample_spacing;
  out << EndMap << Newline;

  key("bodies") << BeginSeq << BeginMap;
  key("name") << "tissue";
  key("kind") << "deformable";
  key("mesh") << mesh_file;
  key("fixed") << d.fixed;
  if (d.blade > 0) {
    key("toughness") << d.toughness << Comment("J/m2: what separating costs");
    key("max_new_nodes") << d.max_new_nodes << Comment("where they are used up nothing is cut any more");
  } else {
    key("removable") << true;
  }
  key("material") << Flow << BeginMap;
  key("young") << young;
  key("poisson") << poisson;
  key("density") << density;
  key("rayleigh") << Flow << BeginMap;
  key("mass") << 2;
  key("stiffness") << 2e-3;
  out << EndMap << EndMap << EndMap << EndSeq << Newline;

  key("instrument") << BeginMap;
  if (d.blade > 0)
    write_blade(out, d);
  else
    write_tip(out, r);
  key("coupling") << Flow << BeginMap;
  key("stiffness") << d.coupling;
  key("rotational_stiffness") << d.rotational_coupling;
  key("damping_time") << 2e-3;
  out << EndMap << EndMap << Newline;

  if (!(d.blade > 0)) {
    key("removal") << Flow << BeginMap;
    key("rate") << 30;
    key("stroke") << 0.2 * r;
    out << EndMap << Newline;
  }
  key("device") << "touch" << Newline;
  key("mapping") << Flow << BeginMap;
  key("position_scale") << d.position_scale;
  key("force_scale") << d.force_scale;
  key("origin") << Flow << std::vector<double>{d.origin.x(), d.origin.y(), d.origin.z()};
  out << EndMap << EndMap;
  return std::string(out.c_str()) + '\n';
}

}  // namespace hapticd
