#include "tools/chart/force/force_table.h"

#include <algorithm>

#include "server/files/input_error.h"
#include "server/files/yaml_keys.h"
#include "server/mesh/mesh_reader.h"

namespace hapticd {

namespace {

MeshFiles read_meshes(const YAML::Node& node, const std::filesystem::path& folder) {
  MeshFiles files;
  for (const auto& entry : node)
    files[entry.first.as<std::string>()] = folder / entry.second.as<std::string>();
  return files;
}

nlohmann::ordered_json words_of(const YAML::Node& node) {
  nlohmann::ordered_json words = nlohmann::ordered_json::object();
  for (const auto& entry : node) {
    const auto key = entry.first.as<std::string>();
    if (key == "label" || key == "quick") continue;
    if (!entry.second.IsScalar()) {
      for (const auto& part : entry.second)
        words[key][part.first.as<std::string>()] = part.second.as<std::string>();
      continue;
    }
    bool flag = false;
    double number = 0;
    if (YAML::convert<bool>::decode(entry.second, flag))
      words[key] = flag;
    else if (YAML::convert<double>::decode(entry.second, number))
      words[key] = number;
    else
      words[key] = entry.second.as<std::string>();
  }
  return words;
}

ForceConfiguration read_configuration(const YamlMap& y, const YAML::Node& raw) {
  y.only({"label",
          "quick",
          "rate",
          "compliance",
          "warping",
          "contact",
          "corotational",
          "friction",
          "rendering",
          "newest_pose",
          "fresh_free_motion",
          "lead",
          "viscous",
          "linearisations",
          "tolerance",
          "sweeps",
          "limits",
          "blend",
          "reference_after",
          "interim",
          "interim_after",
          "refresh",
          "meshes"});
  ForceConfiguration c;
  c.label = y.text("label");
  c.quick = y.flag("quick", false);
  constexpr NumberRange hertz{1, 1000, false, false, "a rate lies between 1 and 1000 Hz"};
  constexpr NumberRange positive{0, 1, true, false, "lies above 0 and is at most 1"};
  if (y.has("rate")) c.rate = y.number("rate", hertz);
  if (y.has("compliance"))
    c.compliance =
        static_cast<ComplianceMethod>(y.choice("compliance", {"exact", "zone", "lazy", "updown", "dense"}));
  if (y.has("warping"))
    c.options.warping = static_cast<Warping>(y.choice("warping", {"none", "node", "piece"}));
  if (y.has("contact")) c.contact = static_cast<Renewal>(y.choice("contact", {"frozen", "renewed"}));
  if (y.has("rendering"))
    c.options.rendering = static_cast<Rendering>(
        y.choice("rendering", {"solved", "held", "extrapolated", "spring", "frozen_friction", "alone"}));
  c.corotational = y.flag("corotational", true);
  c.friction = y.flag("friction", true);
  c.options.newest_pose = y.flag("newest_pose", true);
  c.options.fresh_free_motion = y.flag("fresh_free_motion", true);
  if (y.has("lead")) c.options.lead = y.number("lead", {0, 2, false, false, "lies between 0 and 2 steps"});
  c.options.viscous = y.flag("viscous", true);
  if (y.has("linearisations")) c.options.linearisations = y.whole("linearisations", 1, 20);
  if (y.has("tolerance")) c.options.tolerance = y.number("tolerance", positive);
  if (y.has("sweeps")) c.options.sweeps_only = y.whole("sweeps", 1, 100000);
  c.options.limits = y.flag("limits", false);
  if (y.has("blend")) c.options.blend_time = y.number("blend", positive);
  if (y.has("reference_after")) c.options.reference_after = y.number("reference_after", positive);
  if (y.has("interim_after")) c.options.interim_after = y.number("interim_after", positive);
  if (!y.flag("interim", true)) c.options.interim_after.reset();
  if (!y.flag("refresh", true)) c.options.refresh_at.clear();
  if (raw["meshes"]) c.meshes = read_meshes(raw["meshes"], y.folder());
  c.words = words_of(raw);
  return c;
}

}  // namespace

ForceTable read_force_table(const std::filesystem::path& file) {
  const YamlMap yaml = YamlMap::open(file);
  yaml.only({"default", "finest", "windows", "configurations"});
  const YAML::Node raw = YAML::LoadFile(file.string());
  ForceTable table;
  table.default_label = yaml.text("default");
  if (raw["finest"]) table.finest = read_meshes(raw["finest"], yaml.folder());
  for (const YamlMap& w : yaml.has("windows") ? yaml.maps("windows") : std::vector<YamlMap>{}) {
    w.only({"name", "from", "to", "removals", "history"});
    constexpr NumberRange seconds{0, 3600, false, false, "lies between 0 and 3600 s"};
    table.windows.push_back({w.text("name"), w.number("from", seconds), w.number("to", seconds),
                             w.flag("removals", false), w.flag("history", false)});
    if (table.windows.back().to <= table.windows.back().from) throw w.error("to", "lies after 'from'");
  }
  const std::vector<YamlMap> entries = yaml.maps("configurations");
  for (std::size_t i = 0; i < entries.size(); ++i) {
    ForceConfiguration c = read_configuration(entries[i], raw["configurations"][i]);
    for (const ForceConfiguration& other : table.configurations)
      if (other.label == c.label) throw entries[i].error("label", "'" + c.label + "' is there twice");
    table.configurations.push_back(std::move(c));
  }
  const auto is_default = [&](const ForceConfiguration& c) { return c.label == table.default_label; };
  if (std::none_of(table.configurations.begin(), table.configurations.end(), is_default))
    throw yaml.error("default", "no configuration has the label '" + table.default_label + "'");
  return table;
}

Scene with_meshes(const Scene& scene, const MeshFiles& meshes) {
  Scene result = scene;
  for (SceneBody& body : result.bodies) {
    const auto found = meshes.find(body.name);
    if (found == meshes.end()) continue;
    TetMesh mesh = read_mesh_file(found->second);
    // Fixed are the nodes of the groups that hold the scene's own fixed nodes and no other.
    std::vector<int> fixed;
    for (const MeshGroup& group : body.mesh.groups) {
      const bool held =
          !group.nodes.empty() && std::all_of(group.nodes.begin(), group.nodes.end(), [&](int n) {
            return std::count(body.fixed_nodes.begin(), body.fixed_nodes.end(), n) > 0;
          });
      const MeshGroup* same = held ? mesh.group(group.name) : nullptr;
      if (same) fixed.insert(fixed.end(), same->nodes.begin(), same->nodes.end());
    }
    std::sort(fixed.begin(), fixed.end());
    fixed.erase(std::unique(fixed.begin(), fixed.end()), fixed.end());
    if (fixed.empty() && !body.fixed_nodes.empty())
      throw InputError(found->second, 0, "", "has none of the groups that hold '" + body.name + "'");
    body.mesh = std::move(mesh);
    body.fixed_nodes = std::move(fixed);
  }
  return result;
}

Scene configured(const Scene& scene, const ForceConfiguration& c) {
  Scene result = with_meshes(scene, c.meshes);
  if (c.rate) result.rate = *c.rate;
  if (c.compliance) result.compliance = *c.compliance;
  if (c.contact) result.contact = *c.contact;
  for (SceneBody& body : result.bodies) {
    body.corotational = c.corotational;
    if (!c.friction) body.friction = 0;
  }
  return result;
}

}  // namespace hapticd
