#include "server/scene/scene_bodies.h"

#include <algorithm>
#include <array>

#include "physics/tissue/mesh_quality.h"
#include "server/files/paths.h"
#include "server/mesh/mesh_reader.h"
#include "server/mesh/mesh_unit.h"
#include "server/scene/scene_parts.h"

namespace hapticd {
namespace {

constexpr NumberRange toughness{0, 1e6, true, false, "joules per square metre; soft tissue has 10 to 2000"};
constexpr NumberRange cutting_viscosity{0, 1e6, false, false,
                                        "newton seconds per square metre; 0: the speed does not matter"};
constexpr NumberRange new_nodes{1, 100000, false, false, "nodes that cuts may add"};
constexpr NumberRange faces_per_step{1, 1000, false, false, "faces that may tear in one step"};
constexpr NumberRange friction{0, 10, false, false, "Coulomb's coefficient; 0: frictionless"};
constexpr NumberRange length{0, 2, true, false, "metres"};
constexpr NumberRange radius{0, 0.2, true, false, "metres; a phaco tip has 5e-4"};

TetMesh read_body_mesh(const YamlMap& yaml, const std::filesystem::path& file) {
  if (!is_file(file)) throw yaml.error("mesh", "no such file: " + file.string());
  TetMesh mesh = read_mesh_file(file);
  if (yaml.has("mesh_unit")) {
    const double metres = metres_of_unit(yaml.choice("mesh_unit", mesh_units));
    for (Vec3& x : mesh.nodes) x *= metres;
  }
  return mesh;
}

std::vector<int> read_fixed_nodes(const YamlMap& yaml, const TetMesh& mesh) {
  std::vector<int> fixed;
  if (!yaml.has("fixed")) return fixed;
  for (const std::string& name : yaml.texts("fixed")) {
    const MeshGroup& group = named_group(yaml, "fixed", name, mesh);
    fixed.insert(fixed.end(), group.nodes.begin(), group.nodes.end());
  }
  std::sort(fixed.begin(), fixed.end());
  fixed.erase(std::unique(fixed.begin(), fixed.end()), fixed.end());
  return fixed;
}

// What is near is simulated, the rest condensed (condense_far.h).
NearRegion read_near(const YamlMap& yaml, const SceneBody& body) {
  if (body.toughness > 0)
    throw yaml.error("toughness", "cannot stand beside near: tissue that is cut needs all of itself");
  if (yaml.flag("floating", false))
    throw yaml.error("floating", "cannot stand beside near: what is condensed has to be held");
  const YamlMap region = yaml.map("near");
  region.only({"centre", "radius", "follows"});
  const NearRegion near{region.vec3("centre"), region.number("radius", length),
                        region.flag("follows", false)};
  const auto is_near = [&](const Tet& t) {
    const auto& x = body.mesh.nodes;
    return (0.25 * (x[t[0]] + x[t[1]] + x[t[2]] + x[t[3]]) - near.centre).norm() <= near.radius;
  };
  if (std::none_of(body.mesh.tets.begin(), body.mesh.tets.end(), is_near))
    throw region.error("centre", "no tetrahedron of the mesh is within the radius of it");
  return near;
}

// Each piece of the mesh has a node that is fixed or on a spring.
void require_held(const YamlMap& yaml, const SceneBody& body) {
  const std::vector<int> piece = pieces_of(body.mesh);
  std::vector<bool> held(piece.size());
  for (const int n : body.fixed_nodes) held[piece[n]] = true;
  for (std::size_t n = 0; n < body.springs.size(); ++n)
    if (body.springs[n].stiffness > 0) held[piece[n]] = true;
  for (std::size_t n = 0; n < piece.size(); ++n)
    if (!held[piece[n]])
      throw yaml.error(yaml.has("fixed") ? "fixed" : "springs",
                       "part of the mesh is held by no fixed node and no spring: the piece with node " +
                           std::to_string(n + 1) + " of " + std::to_string(piece.size()) +
                           " (fix some of it, or say floating: true instead)");
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
    throw yaml.error(
        "motion",
        "static needs a body that is held, cannot be cut, is not stretched and has no springs: a loose "
        "piece has nothing but its mass");
}

// What can be cut needs room for what cuts add; what tears, how far around a front to look.
void read_toughness(const YamlMap& yaml, SceneBody& body) {
  body.toughness = yaml.number("toughness", toughness);
  body.max_new_nodes = static_cast<int>(yaml.number("max_new_nodes", new_nodes));
  body.cutting_viscosity = yaml.number("cutting_viscosity", cutting_viscosity, 0);
  if (!yaml.has("tearing")) return;
  const YamlMap tearing = yaml.map("tearing");
  tearing.only({"radius", "faces_per_step", "begins", "clefts"});
  body.tearing.toughness = body.toughness;
  body.tearing.begins = tearing.flag("begins", false);
  if (tearing.has("clefts") && !body.tearing.begins)
    throw tearing.error("clefts", "needs begins: true: fronts of slits run along any face");
  if (!body.tearing.begins || tearing.has("radius")) body.tearing.radius = tearing.number("radius", length);
  body.tearing.most = static_cast<int>(tearing.number("faces_per_step", faces_per_step, body.tearing.most));
}

void read_parts(const YamlMap& yaml, SceneBody& body) {
  body.regions = read_regions(yaml, body.mesh, body.material);
  if (is_stretched(body) && body.toughness > 0)
    throw yaml.error("toughness",
                     "tissue that stands stretched cannot be cut by a blade (removable it may be)");
  body.springs = read_springs(yaml, body.mesh);
  if (yaml.has("tearing")) body.tearing.clefts = read_clefts(yaml.map("tearing"), body.mesh);
}

void read_support(const YamlMap& yaml, SceneBody& body) {
  const bool floating = yaml.flag("floating", false);
  for (const char* key : {"fixed", "springs"})
    if (floating && yaml.has(key)) throw yaml.error("floating", std::string("cannot stand beside ") + key);
  if (floating) return;
  if (!yaml.has("fixed") && body.springs.empty())
    throw yaml.error("fixed",
                     "is missing: nothing holds this body (name a group of its mesh: " +
                         (body.mesh.groups.empty() ? "it has none" : listed(group_names(body.mesh))) +
                         "; or give it springs; or say floating: true)");
  body.fixed_nodes = read_fixed_nodes(yaml, body.mesh);
  require_held(yaml, body);
}

SceneBody read_body(const YamlMap& yaml) {
  yaml.only(
      {"name",     "kind",      "mesh",      "mesh_unit",         "material",      "fixed",   "floating",
       "friction", "removable", "toughness", "cutting_viscosity", "max_new_nodes", "tearing", "elements",
       "motion",   "simulated", "position",  "orientation",       "scale",         "regions", "stretch",
       "springs",  "near"});
  SceneBody body;
  body.name = yaml.text("name");
  body.kind = yaml.choice("kind", {"deformable", "rigid"}) == 0 ? BodyKind::deformable : BodyKind::rigid;
  body.mesh_file = yaml.folder() / yaml.text("mesh");
  body.friction = yaml.number("friction", friction, 0);
  if (body.kind == BodyKind::rigid) {
    for (const char* key :
         {"material", "fixed", "floating", "removable", "toughness", "cutting_viscosity", "max_new_nodes",
          "tearing", "elements", "motion", "simulated", "regions", "stretch", "springs", "near"})
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
  place(yaml, body.mesh);
  if (body.kind == BodyKind::rigid) return body;

  read_parts(yaml, body);
  read_support(yaml, body);
  if (yaml.has("near")) body.near = read_near(yaml, body);
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
