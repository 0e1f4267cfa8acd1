#include "server/scene/scene_bodies.h"

#include <algorithm>
#include <array>

#include "physics/tissue/mesh_quality.h"
#include "server/files/paths.h"
#include "server/mesh/mesh_reader.h"

namespace hapticd {
namespace {

constexpr NumberRange young{1, 1e12, false, false,
                            "Young's modulus in pascals; soft tissue has kilopascals: 3e3"};
constexpr NumberRange poisson{-1, 0.5, true, true, "Poisson's ratio; 0.5 would be incompressible"};
constexpr NumberRange poisson_cap{0, 0.5, true, true, "Poisson's ratio that linear tetrahedra bear: 0.45"};
constexpr NumberRange density{0, 1e5, true, false, "kilograms per cubic metre; tissue has about 1000"};
constexpr NumberRange rayleigh_mass{0, 1e4, false, false, "alpha of B = alpha M + beta K, in 1/s"};
constexpr NumberRange rayleigh_stiffness{0, 10, false, false, "beta of B = alpha M + beta K, in seconds"};
constexpr NumberRange toughness{0, 1e6, true, false, "joules per square metre; soft tissue has 10 to 2000"};
constexpr NumberRange cutting_viscosity{0, 1e6, false, false,
                                        "newton seconds per square metre; 0: the speed does not matter"};
constexpr NumberRange new_nodes{1, 100000, false, false, "nodes that cuts may add"};
constexpr NumberRange faces_per_step{1, 1000, false, false, "faces that may tear in one step"};
constexpr NumberRange friction{0, 10, false, false, "Coulomb's coefficient; 0: frictionless"};
constexpr NumberRange length{0, 2, true, false, "metres"};
constexpr NumberRange radius{0, 0.2, true, false, "metres; a phaco tip has 5e-4"};

std::vector<std::string> names_of(const std::vector<MeshGroup>& groups) {
  std::vector<std::string> names;
  for (const MeshGroup& g : groups) names.push_back(g.name);
  return names;
}

TetMesh read_body_mesh(const YamlMap& yaml, const std::filesystem::path& file) {
  if (!std::filesystem::is_regular_file(file)) throw yaml.error("mesh", "no such file: " + file.string());
  TetMesh mesh = read_mesh_file(file);
  if (yaml.has("mesh_unit") && yaml.choice("mesh_unit", {"m", "mm"}) == 1)
    for (Vec3& x : mesh.nodes) x *= 1e-3;
  return mesh;
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

std::vector<int> read_fixed_nodes(const YamlMap& yaml, const TetMesh& mesh) {
  std::vector<int> fixed;
  for (const std::string& name : yaml.texts("fixed")) {
    const MeshGroup* group = mesh.group(name);
    if (!group) {
      const std::string hint = did_you_mean(name, names_of(mesh.groups));
      throw yaml.error(
          "fixed", "the mesh has no group '" + name + "' (" + (hint.empty() ? "" : hint + " ") +
                       "its groups: " + (mesh.groups.empty() ? "none" : listed(names_of(mesh.groups))) + ")");
    }
    fixed.insert(fixed.end(), group->nodes.begin(), group->nodes.end());
  }
  std::sort(fixed.begin(), fixed.end());
  fixed.erase(std::unique(fixed.begin(), fixed.end()), fixed.end());

  const std::vector<int> piece = pieces_of(mesh);
  std::vector<bool> held(mesh.nodes.size());
  for (int n : fixed) held[piece[n]] = true;
  for (std::size_t n = 0; n < piece.size(); ++n)
    if (!held[piece[n]])
      throw yaml.error("fixed", "part of the mesh is held by no fixed node: the piece with node " +
                                    std::to_string(n + 1) + " of " + std::to_string(piece.size()) +
                                    " (fix some of it, or say floating: true instead)");
  return fixed;
}

Pose read_placement(const YamlMap& yaml) {
  return {yaml.vec3("position", Vec3::Zero()), yaml.quaternion("orientation")};
}

// A capsule's or cylinder's axis, between two points or by its length along z.
void read_axis(const YamlMap& yaml, Primitive& primitive) {
  if (!yaml.has("from") && !yaml.has("to")) {
    primitive.half_length = 0.5 * yaml.number("length", length);
    primitive.placement = read_placement(yaml);
    return;
  }
  for (const char* other : {"length", "position", "orientation"})
    if (yaml.has(other)) throw yaml.error(other, "cannot stand beside from and to");
  const Vec3 from = yaml.vec3("from"), to = yaml.vec3("to"), axis = to - from;
  if (axis.norm() < 1e-9) throw yaml.error("to", "is the same point as from");
  primitive.half_length = 0.5 * axis.norm();
  primitive.placement = {0.5 * (from + to), Quat::FromTwoVectors(Vec3::UnitZ(), axis)};
}

Primitive read_convex(const YamlMap& yaml, const std::string& name) {
  if (yaml.has("points") == yaml.has("mesh")) throw yaml.error("points", "either points or mesh is needed");
  const std::vector<Vec3> points = yaml.has("points")
                                       ? yaml.points("points")
                                       : read_body_mesh(yaml, yaml.folder() / yaml.text("mesh")).nodes;
  try {
    return make_convex(name, points, read_placement(yaml));
  } catch (const std::invalid_argument& e) {
    throw yaml.error(yaml.has("points") ? "points" : "mesh", e.what());
  }
}

Primitive read_primitive(const YamlMap& yaml) {
  const std::string name = yaml.text("name");
  const auto shape = static_cast<Shape>(yaml.choice("shape", {"sphere", "capsule", "cylinder", "convex"}));
  if (shape == Shape::convex) {
    yaml.only({"name", "shape", "points", "mesh", "mesh_unit", "position", "orientation"});
    return read_convex(yaml, name);
  }
  Primitive primitive;
  primitive.name = name;
  primitive.shape = shape;
  if (shape == Shape::sphere) {
    yaml.only({"name", "shape", "radius", "position"});
    primitive.placement.p = yaml.vec3("position", Vec3::Zero());
  } else {
    yaml.only({"name", "shape", "radius", "length", "position", "orientation", "from", "to"});
    read_axis(yaml, primitive);
  }
  primitive.radius = yaml.number("radius", radius);
  return primitive;
}

}  // namespace

void read_body_pins(const YamlMap& yaml, SceneBody& body) {
  body.pinned_elements = yaml.has("elements");
  body.pinned_motion = yaml.has("motion");
  body.pinned_simulated = yaml.has("simulated");
  if (body.pinned_elements) body.corotational = yaml.choice("elements", {"corotational", "linear"}) == 0;
  if (body.pinned_motion) body.dynamic = yaml.choice("motion", {"dynamic", "static"}) == 0;
  body.simulated = yaml.flag("simulated", true);
  if (!body.dynamic && !may_be_static(body))
    throw yaml.error("motion",
                     "static needs a body that is held and cannot be cut: a loose piece has nothing but "
                     "its mass");
}

// What can be cut needs room for what cuts add; what tears, how far around a front to look.
void read_toughness(const YamlMap& yaml, SceneBody& body) {
  body.toughness = yaml.number("toughness", toughness);
  body.max_new_nodes = static_cast<int>(yaml.number("max_new_nodes", new_nodes));
  body.cutting_viscosity = yaml.number("cutting_viscosity", cutting_viscosity, 0);
  if (!yaml.has("tearing")) return;
  const YamlMap tearing = yaml.map("tearing");
  tearing.only({"radius", "faces_per_step"});
  body.tearing.toughness = body.toughness;
  body.tearing.radius = tearing.number("radius", length);
  body.tearing.most = static_cast<int>(tearing.number("faces_per_step", faces_per_step, body.tearing.most));
}

SceneBody read_body(const YamlMap& yaml) {
  yaml.only({"name", "kind", "mesh", "mesh_unit", "material", "fixed", "floating", "friction", "removable",
             "toughness", "cutting_viscosity", "max_new_nodes", "tearing", "elements", "motion",
             "simulated"});
  SceneBody body;
  body.name = yaml.text("name");
  body.kind = yaml.choice("kind", {"deformable", "rigid"}) == 0 ? BodyKind::deformable : BodyKind::rigid;
  body.mesh_file = yaml.folder() / yaml.text("mesh");
  body.friction = yaml.number("friction", friction, 0);
  if (body.kind == BodyKind::rigid) {
    for (const char* key : {"material", "fixed", "floating", "removable", "toughness", "cutting_viscosity",
                            "max_new_nodes", "tearing", "elements", "motion", "simulated"})
      if (yaml.has(key)) throw yaml.error(key, "a rigid body has none (it is a fixed obstacle)");
  } else {
    body.material = read_material(yaml.map("material"));
    body.removable = yaml.flag("removable", false);
    for (const char* key : {"cutting_viscosity", "max_new_nodes", "tearing"})
      if (yaml.has(key) && !yaml.has("toughness"))
        throw yaml.error(key, "needs a toughness, in J/m²: without one nothing cuts or tears this body");
    if (yaml.has("toughness")) read_toughness(yaml, body);
  }
  body.mesh = read_body_mesh(yaml, body.mesh_file);
  if (body.kind == BodyKind::rigid) return body;

  const bool floating = yaml.flag("floating", false);
  if (floating && yaml.has("fixed")) throw yaml.error("floating", "cannot stand beside fixed");
  if (!floating && !yaml.has("fixed"))
    throw yaml.error("fixed",
                     "is missing: nothing holds this body (name a group of its mesh: " +
                         (body.mesh.groups.empty() ? "it has none" : listed(names_of(body.mesh.groups))) +
                         "; or say floating: true)");
  if (!floating) body.fixed_nodes = read_fixed_nodes(yaml, body.mesh);
  read_body_pins(yaml, body);
  return body;
}

ContactPair read_contact(const YamlMap& yaml, const std::vector<SceneBody>& bodies) {
  yaml.only({"between", "friction"});
  const std::vector<std::string> named = yaml.texts("between");
  if (named.size() != 2) throw yaml.error("between", "names two bodies: [nodes of this, faces of that]");
  std::array<int, 2> index{};
  for (int k = 0; k < 2; ++k) {
    const auto found =
        std::find_if(bodies.begin(), bodies.end(), [&](const SceneBody& b) { return b.name == named[k]; });
    if (found == bodies.end()) {
      std::vector<std::string> names;
      for (const SceneBody& b : bodies) names.push_back(b.name);
      const std::string hint = did_you_mean(named[k], names);
      throw yaml.error("between", "there is no body '" + named[k] + "' (" + (hint.empty() ? "" : hint + " ") +
                                      "there are: " + listed(names) + ")");
    }
    index[k] = static_cast<int>(found - bodies.begin());
  }
  if (bodies[index[0]].kind == BodyKind::rigid && bodies[index[1]].kind == BodyKind::rigid)
    throw yaml.error("between", "neither body can move: both are fixed obstacles");
  return {index[0], index[1], yaml.number("friction", friction, 0)};
}

Instrument read_instrument(const YamlMap& yaml) {
  Instrument instrument;
  std::vector<std::string> names;
  for (const YamlMap& entry : yaml.maps("primitives")) {
    instrument.primitives.push_back(read_primitive(entry));
    const std::string& name = instrument.primitives.back().name;
    if (std::find(names.begin(), names.end(), name) != names.end())
      throw entry.error("name", "'" + name + "' is another primitive's name already");
    names.push_back(name);
  }
  const std::string tip = yaml.text("tip");
  const auto found = std::find(names.begin(), names.end(), tip);
  if (found == names.end())
    throw yaml.error("tip", "there is no primitive '" + tip + "' (there are: " + listed(names) + ")");
  instrument.tip = static_cast<int>(found - names.begin());
  return instrument;
}

}  // namespace hapticd
