#include "server/scene/scene_parts.h"

#include <algorithm>

#include "physics/tissue/surface.h"

namespace hapticd {
namespace {

constexpr NumberRange young{1, 1e12, false, false,
                            "Young's modulus in pascals; soft tissue has kilopascals: 3e3"};
constexpr NumberRange poisson{-1, 0.5, true, true, "Poisson's ratio; 0.5 would be incompressible"};
constexpr NumberRange poisson_cap{0, 0.5, true, true, "Poisson's ratio that linear tetrahedra bear: 0.45"};
constexpr NumberRange density{0, 1e5, true, false, "kilograms per cubic metre; tissue has about 1000"};
constexpr NumberRange rayleigh_mass{0, 1e4, false, false, "alpha of B = alpha M + beta K, in 1/s"};
constexpr NumberRange rayleigh_stiffness{0, 10, false, false, "beta of B = alpha M + beta K, in seconds"};
constexpr NumberRange scale{1e-6, 1e6, false, false,
                            "1: the mesh as it is; a mirrored body needs another mesh"};
constexpr NumberRange node_stiffness{0, 1e9, true, false, "newtons per metre, of each node of the group"};
constexpr NumberRange area_stiffness{0, 1e15, true, false,
                                     "newtons per metre and square metre of the group's surface"};
constexpr double farthest = 100;  // from the scene's origin [m]
constexpr double least_stretch = 0.5, greatest_stretch = 2;

Vec3 read_stretch(const YamlMap& yaml) {
  if (!yaml.has("stretch")) return Vec3::Ones();
  const Vec3 stretch = yaml.vec3("stretch");
  if (stretch.minCoeff() < least_stretch || stretch.maxCoeff() > greatest_stretch)
    throw yaml.error("stretch",
                     "each axis lies between 0.5 and 2: how many times its natural length the tissue "
                     "has where the mesh stands (1: no tension)");
  return stretch;
}

// Of the boundary whose three nodes are in the group, a third of each face for each node [m²].
std::vector<double> area_of_nodes(const TetMesh& mesh, const MeshGroup& group) {
  std::vector<double> area(mesh.nodes.size(), 0);
  const auto has = [&](int n) { return std::binary_search(group.nodes.begin(), group.nodes.end(), n); };
  const BoundarySurface surface(mesh);
  for (const SurfaceFace& face : surface.faces()) {
    const Triangle& t = face.nodes;
    if (!has(t[0]) || !has(t[1]) || !has(t[2])) continue;
    const Vec3 &a = mesh.nodes[t[0]], &b = mesh.nodes[t[1]], &c = mesh.nodes[t[2]];
    for (const int n : t) area[n] += (b - a).cross(c - a).norm() / 6;
  }
  return area;
}

void add_springs(const YamlMap& yaml, const TetMesh& mesh, std::vector<NodeSpring>& springs) {
  yaml.only({"group", "stiffness", "stiffness_per_area", "rest_offset"});
  const MeshGroup& group = named_group(yaml, "group", yaml.text("group"), mesh);
  const bool by_area = yaml.has("stiffness_per_area");
  if (by_area == yaml.has("stiffness"))
    throw yaml.error("stiffness",
                     "either stiffness (of each node, N/m) or stiffness_per_area (N/m³) is needed");
  const double k =
      by_area ? yaml.number("stiffness_per_area", area_stiffness) : yaml.number("stiffness", node_stiffness);
  const Vec3 offset = yaml.vec3("rest_offset", Vec3::Zero());
  if (offset.norm() > farthest) throw yaml.error("rest_offset", "is farther than 100 m: it is in metres");
  const std::vector<double> area = by_area ? area_of_nodes(mesh, group) : std::vector<double>{};
  bool any = false;
  for (const int n : group.nodes) {
    const double stiffness = by_area ? k * area[n] : k;
    if (!(stiffness > 0)) continue;
    any = true;
    if (springs[n].stiffness > 0)
      throw yaml.error("group", "node " + std::to_string(n + 1) + " has a spring of another entry already");
    springs[n] = {stiffness, mesh.nodes[n] + offset};
  }
  if (!any)
    throw yaml.error("group", "'" + group.name +
                                  "' has no face on the body's surface: say stiffness instead of "
                                  "stiffness_per_area");
}

// What a region does not say is the body's.
Material material_of_region(const YamlMap& region, const YamlMap& body, const Material& otherwise) {
  const YamlMap whole = body.map("material");
  Material m = otherwise;
  m.young = region.number("young", young, whole.number("young", young));
  m.poisson = region.number("poisson", poisson, whole.number("poisson", poisson));
  m.density = region.number("density", density, otherwise.density);
  return whole.has("poisson_cap") ? lowered(m, whole.number("poisson_cap", poisson_cap)) : m;
}

}  // namespace

void place(const YamlMap& body, TetMesh& mesh) {
  const double s = body.number("scale", scale, 1);
  const Quat turn = body.quaternion("orientation");
  const Vec3 position = body.vec3("position", Vec3::Zero());
  if (position.norm() > farthest) throw body.error("position", "is farther than 100 m: it is in metres");
  if (!body.has("scale") && !body.has("orientation") && !body.has("position")) return;
  for (Vec3& x : mesh.nodes) x = position + turn * (s * x);
}

std::vector<std::string> group_names(const TetMesh& mesh) {
  std::vector<std::string> names;
  for (const MeshGroup& g : mesh.groups) names.push_back(g.name);
  return names;
}

const MeshGroup& named_group(const YamlMap& yaml, const std::string& key, const std::string& name,
                             const TetMesh& mesh) {
  if (const MeshGroup* group = mesh.group(name)) return *group;
  const std::vector<std::string> names = group_names(mesh);
  const std::string hint = did_you_mean(name, names);
  throw yaml.error(key, "the mesh has no group '" + name + "' (" + (hint.empty() ? "" : hint + " ") +
                            "its groups: " + (names.empty() ? "none" : listed(names)) + ")");
}

Material read_material(const YamlMap& yaml) {
  yaml.only({"young", "poisson", "density", "poisson_cap", "rayleigh", "law"});
  Material material;
  material.young = yaml.number("young", young);
  material.poisson = yaml.number("poisson", poisson);
  material.density = yaml.number("density", density);
  if (yaml.has("poisson_cap")) material = lowered(material, yaml.number("poisson_cap", poisson_cap));
  if (yaml.has("law")) material.law = static_cast<Law>(yaml.choice("law", {"corotational", "guarded"}));
  if (yaml.has("rayleigh")) {
    const YamlMap rayleigh = yaml.map("rayleigh");
    rayleigh.only({"mass", "stiffness"});
    material.rayleigh_mass = rayleigh.number("mass", rayleigh_mass, 0);
    material.rayleigh_stiffness = rayleigh.number("stiffness", rayleigh_stiffness, 0);
  }
  return material;
}

std::vector<TissueRegion> read_regions(const YamlMap& body, const TetMesh& mesh, const Material& material) {
  std::vector<TissueRegion> regions;
  const Vec3 stretch = read_stretch(body);
  std::vector<char> taken(mesh.tets.size(), 0);
  if (body.has("regions"))
    for (const YamlMap& yaml : body.maps("regions")) {
      yaml.only({"group", "young", "poisson", "density", "stretch"});
      const MeshGroup& group = named_group(yaml, "group", yaml.text("group"), mesh);
      if (group.tets.empty())
        throw yaml.error("group", "'" + group.name +
                                      "' has no tetrahedra: a region is a physical volume of the "
                                      "mesh (in VTK an integer array on the cells)");
      for (const int t : group.tets)
        if (taken[t]++)
          throw yaml.error("group", "'" + group.name + "' shares tetrahedron " + std::to_string(t + 1) +
                                        " with another region");
      regions.push_back({group.tets, material_of_region(yaml, body, material),
                         yaml.has("stretch") ? read_stretch(yaml) : stretch});
    }
  if (stretch == Vec3::Ones()) return regions;
  TissueRegion rest{{}, material, stretch};
  for (std::size_t t = 0; t < taken.size(); ++t)
    if (!taken[t]) rest.tets.push_back(static_cast<int>(t));
  if (!rest.tets.empty()) regions.push_back(std::move(rest));
  return regions;
}

std::vector<NodeSpring> read_springs(const YamlMap& body, const TetMesh& mesh) {
  if (!body.has("springs")) return {};
  std::vector<NodeSpring> springs(mesh.nodes.size());
  for (const YamlMap& yaml : body.maps("springs")) add_springs(yaml, mesh, springs);
  return springs;
}

std::vector<std::uint8_t> read_clefts(const YamlMap& tearing, const TetMesh& mesh) {
  std::vector<std::uint8_t> clefts;
  if (!tearing.has("clefts")) return clefts;
  clefts.resize(4 * mesh.tets.size(), 0);
  for (const std::string& name : tearing.texts("clefts")) {
    const MeshGroup& group = named_group(tearing, "clefts", name, mesh);
    const auto has = [&](int n) { return std::binary_search(group.nodes.begin(), group.nodes.end(), n); };
    bool any = false;
    for (std::size_t id = 0; id < clefts.size(); ++id) {
      const Triangle n = outward_face(mesh.tets[id / 4], static_cast<int>(id % 4));
      if (!std::all_of(n.begin(), n.end(), has)) continue;
      clefts[id] = 1;
      any = true;
    }
    if (!any) throw tearing.error("clefts", "'" + name + "' has no face: name a surface inside of the mesh");
  }
  return clefts;
}

}  // namespace hapticd
