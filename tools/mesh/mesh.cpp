// haptic mesh: what a mesh is like, whether hapticd runs on it, what can be repaired, and a scene for it.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <memory>
#include <tuple>

#include "physics/tissue/mesh_quality.h"
#include "server/files/input_error.h"
#include "server/files/paths.h"
#include "server/mesh/mesh_repair.h"
#include "server/mesh/mesh_unit.h"
#include "server/mesh/mesh_writer.h"
#include "server/os/realtime.h"
#include "server/plan/model_trial.h"
#include "server/scene/plausibility.h"
#include "server/scene/scene_reader.h"
#include "tools/cli/command.h"
#include "tools/cli/report.h"
#include "tools/mesh/foreign_mesh.h"
#include "tools/mesh/mesh_scene.h"

namespace hapticd {
namespace {

struct MeshOptions {
  std::string file, fix, scene, json;
  bool force = false;
  std::string unit = "m";
  double edge = 0;
  bool keep_duplicates = false, blade = false;
};

std::string joined(const std::string& a, const std::string& b) { return a.empty() ? b : a + ", " + b; }

std::string faults_text(const MeshFaults& f) {
  std::string out;
  const auto say = [&](int count, const char* what) {
    if (count > 0) out = joined(out, std::to_string(count) + " " + what);
  };
  say(f.inverted, "inverted tetrahedra");
  say(f.duplicate_nodes, "duplicate nodes");
  say(f.collapsed, "tetrahedra between duplicates");
  say(f.repeated, "tetrahedra twice");
  say(f.orphan_nodes, "nodes of no tetrahedron");
  if (f.pieces_before != f.pieces)
    out = joined(out,
                 std::to_string(f.pieces_before) + " pieces that merging makes " + std::to_string(f.pieces));
  if (out.empty()) return "none";
  return f.first_inverted_line > 0
             ? out + " (the first inverted one in line " + std::to_string(f.first_inverted_line) + ")"
             : out;
}

nlohmann::ordered_json to_json(const Span& s) {
  return {{"min", s.least}, {"mean", s.mean}, {"max", s.greatest}};
}
nlohmann::ordered_json to_json(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

nlohmann::ordered_json to_json(const TetMesh& mesh, const MeshQuality& q, const MeshFaults& f,
                               const std::vector<int>& zones) {
  nlohmann::ordered_json json;
  json["command"] = "mesh";
  json["nodes"] = mesh.nodes.size();
  json["tetrahedra"] = mesh.tets.size();
  json["pieces"] = q.pieces;
  json["box_m"] = {to_json(q.low), to_json(q.high)};
  json["volume_m3"] = {{"total", q.total_volume}, {"min", q.volume.least}, {"max", q.volume.greatest}};
  json["edge_m"] = to_json(q.edge);
  json["mean_ratio"] = to_json(q.ratio);
  json["mean_ratio_histogram"] = q.histogram;
  json["slivers"] = q.slivers;
  json["dihedral_degrees"] = to_json(q.dihedral);
  json["boundary"] = {{"faces", q.boundary_faces},  {"nodes", q.boundary_nodes},
                      {"area_m2", q.boundary_area}, {"shells", q.shells},
                      {"open_edges", q.open_edges}, {"edge_m", to_json(q.surface_edge)}};
  json["groups"] = nlohmann::ordered_json::array();
  for (const MeshGroup& g : mesh.groups)
    json["groups"].push_back({{"name", g.name}, {"nodes", g.nodes.size()}, {"tetrahedra", g.tets.size()}});
  json["faults"] = {{"inverted", f.inverted},         {"duplicate_nodes", f.duplicate_nodes},
                    {"collapsed", f.collapsed},       {"repeated", f.repeated},
                    {"orphan_nodes", f.orphan_nodes}, {"pieces_before", f.pieces_before}};
  json["zone_nodes"] = {{"min", zones.front()}, {"median", zones[zones.size() / 2]}, {"max", zones.back()}};
  return json;
}

// Of what is as large as no organ.
std::string unit_hint(double diagonal) {
  const std::string unit = likely_unit(diagonal);
  return unit.empty() ? "" : ": is it in " + unit + "? (--unit " + unit + ")";
}

void print_quality(const TetMesh& mesh, const MeshQuality& q, const MeshFaults& faults,
                   const std::vector<int>& zones) {
  const auto mm = [](double m) { return fixed(1e3 * m, 3); };
  Table table = {
      {"nodes, tetrahedra", std::to_string(mesh.nodes.size()) + ", " + std::to_string(mesh.tets.size())},
      {"faults in the file", faults_text(faults)},
      {"pieces", std::to_string(q.pieces)},
      {"box", mm(q.high.x() - q.low.x()) + " x " + mm(q.high.y() - q.low.y()) + " x " +
                  mm(q.high.z() - q.low.z()) + " mm" + unit_hint(q.diagonal())},
      {"volume", fixed(1e9 * q.total_volume, 3) + " mm3; of a tetrahedron " + fixed(1e9 * q.volume.least, 6) +
                     " to " + fixed(1e9 * q.volume.greatest, 6)},
      {"edges", mm(q.edge.least) + " to " + mm(q.edge.greatest) + " mm, mean " + mm(q.edge.mean)},
      {"mean ratio", fixed(q.ratio.least, 3) + " to " + fixed(q.ratio.greatest, 3) + ", mean " +
                         fixed(q.ratio.mean, 3) + "; " + std::to_string(q.slivers) + " slivers below 0.1"},
      {"dihedral angles", fixed(q.dihedral.least, 1) + " to " + fixed(q.dihedral.greatest, 1) + " degrees"},
      {"boundary", std::to_string(q.boundary_faces) + " faces, " + std::to_string(q.boundary_nodes) +
                       " nodes, " + fixed(1e6 * q.boundary_area, 2) + " mm2, " + std::to_string(q.shells) +
                       " shells, " + std::to_string(q.open_edges) + " pinched edges"},
      {"zone", std::to_string(zones.front()) + " to " + std::to_string(zones.back()) + " nodes, median " +
                   std::to_string(zones[zones.size() / 2]) + " (of at most 200)"}};
  for (const MeshGroup& g : mesh.groups)
    table.push_back({"group " + g.name, std::to_string(g.nodes.size()) + " nodes, " +
                                            std::to_string(g.tets.size()) + " tetrahedra"});
  print(table);
  std::printf("\n  mean ratio   tetrahedra\n");
  const int most = *std::max_element(q.histogram.begin(), q.histogram.end());
  for (int bin = 0; bin < 10; ++bin)
    std::printf(
        "  %.1f to %.1f  %8d  %s\n", 0.1 * bin, 0.1 * (bin + 1), q.histogram[bin],
        std::string(static_cast<std::size_t>(most > 0 ? 40L * q.histogram[bin] / most : 0), '#').c_str());
}

// The scene's mesh, beside it. The name is not the stem's alone: FILE often has that one.
std::filesystem::path mesh_beside(const std::filesystem::path& scene) {
  return scene.parent_path() / (scene.stem().string() + "_mesh.msh");
}

std::string write_scene(TetMesh mesh, const SceneDefaults& defaults, const std::filesystem::path& scene) {
  add_fixed_group(mesh, defaults);
  const std::filesystem::path mesh_file = mesh_beside(scene);
  write_mesh_file(mesh, mesh_file);
  write_file(scene.string(), scene_text(defaults, scene.stem().string(), mesh_file.filename().string()));
  return mesh_file.string();
}

// A directory of its own that is gone with the object.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "haptic-mesh-XXXXXX").string();
    if (!mkdtemp(name.data())) throw std::runtime_error("no temporary directory could be made");
    path = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  std::filesystem::path path;
};

// What a step of the whole model takes here, pressed by the default scene's tip.
nlohmann::ordered_json predict(const TetMesh& mesh, const SceneDefaults& defaults) {
  constexpr double seconds = 0.1;
  const ScratchFolder scratch;
  const std::filesystem::path file = scratch.path / "mesh.yaml";
  write_scene(mesh, defaults, file);
  Scene scene = read_scene(file);
  scene.plans = false;
  keep_malloc_pages();
  nlohmann::ordered_json json;
  const PilotStroke stroke = pilot_stroke(scene, seconds);
  for (const auto& [method, name, most_nodes] :
       {std::tuple{ComplianceMethod::exact, "exact", std::size_t{6000}},
        {ComplianceMethod::zone, "zone", std::size_t{30000}}}) {
    if (mesh.nodes.size() > most_nodes) {
      std::printf("  a step with %-5s   not tried beyond %zu nodes\n", name, most_nodes);
      continue;
    }
    scene.compliance = method;
    const TrialRun run = run_pilot(scene, stroke);
    if (run.force.empty()) {
      std::printf("  a step with %-5s   the matrix is singular\n", name);
      continue;
    }
    std::printf("  a step with %-5s   %.2f ms, a haptic tick %.3f ms: %s\n", name, run.step_ms, run.tick_ms,
                run.worst_step_ms < 16 ? "50 Hz" : "misses 50 Hz");
    json[name] = {{"step_ms", run.step_ms}, {"worst_step_ms", run.worst_step_ms}, {"tick_ms", run.tick_ms}};
  }
  return json;
}

void check_outputs(const MeshOptions& o) {
  const OutputRule rule(o.force);
  rule.require_new("--fix", o.fix);
  rule.require_figures("--json", o.json);
  if (o.blade && o.scene.empty()) throw UsageError("--blade is of a scene: say --scene OUT.yaml too");
  if (o.scene.empty()) return;
  const std::string ending = std::filesystem::path(o.scene).extension().string();
  if (ending != ".yaml" && ending != ".yml")
    throw UsageError("--scene " + o.scene + ": a scene is a .yaml file");
  rule.require_new("--scene", o.scene);
  rule.require_new("--scene (its mesh)", mesh_beside(o.scene));
}

int run(const MeshOptions& o) {
  check_outputs(o);
  if (!is_file(o.file)) throw InputError(o.file, 0, "", "no such file");
  const ScratchFolder scratch;
  ForeignMesh read = read_any_mesh(o.file, {o.edge, scratch.path});
  for (const std::string& command : read.commands) std::printf("made by   %s\n", command.c_str());
  const bool foreign = !read.commands.empty();
  RepairedMesh repaired = repair_mesh(std::move(read.mesh), !o.keep_duplicates);
  TetMesh& mesh = repaired.mesh;
  const auto unit = std::find(mesh_units.begin(), mesh_units.end(), o.unit) - mesh_units.begin();
  for (Vec3& x : mesh.nodes) x *= metres_of_unit(static_cast<int>(unit));
  const MeshQuality quality = measure_mesh(mesh);
  const SceneDefaults defaults = scene_defaults(mesh, quality, o.blade);
  const std::vector<int> zones = nodes_in_reach(mesh, defaults.tip_radius, defaults.alarm_distance);
  print_quality(mesh, quality, repaired.faults, zones);
  nlohmann::ordered_json json = to_json(mesh, quality, repaired.faults, zones);
  std::printf("\n");
  std::string refused;
  try {
    json["predicted"] = predict(mesh, defaults);
  } catch (const InputError& e) {  // the scene's, which was made for this alone: its name says nothing
    const std::string text = e.what();
    refused = text.substr(text.find(": ", e.file().string().size()) + 2);
    if (!o.scene.empty())
      throw InputError(o.file, 0, "",
                       "no scene is made of this size" + unit_hint(quality.diagonal()) + ": " + refused);
    std::printf("  no step is tried    a scene of this size is refused: %s\n", refused.c_str());
  }

  if (!o.fix.empty()) {
    try {
      write_mesh_file(mesh, o.fix);
    } catch (const std::invalid_argument& e) {
      throw UsageError(e.what());
    }
    std::printf("\nwritten: %s, in metres\n", o.fix.c_str());
    json["fixed"] = o.fix;
  }
  if (!o.scene.empty()) {
    const std::string mesh_file = write_scene(mesh, defaults, o.scene);
    std::printf("\nwritten: %s and %s\n", o.scene.c_str(), mesh_file.c_str());
    for (const std::string& reason : defaults.reasons) std::printf("  %s\n", reason.c_str());
    const std::vector<std::string> doubted = doubts(read_scene(o.scene));
    for (const std::string& doubt : doubted) std::printf("  doubt: %s\n", doubt.c_str());
    json["scene"] = {
        {"file", o.scene}, {"mesh", mesh_file}, {"reasons", defaults.reasons}, {"doubts", doubted}};
  }
  if (!o.json.empty()) write_json(o.json, json);
  if (!refused.empty()) return 1;
  if (!o.fix.empty() || !o.scene.empty() || !(foreign || repaired.faults.refused())) return 0;
  std::printf("\nhapticd refuses this file as it stands: --fix OUT.msh writes one that it takes\n");
  return 1;
}

}  // namespace

Command add_mesh(CLI::App& application) {
  auto options = std::make_shared<MeshOptions>();
  CLI::App* app = application.add_subcommand(
      "mesh", "Inspects a mesh, repairs it, makes it or a closed surface a scene.");
  app->add_option("FILE", options->file,
                  "Gmsh 2.2 or 4.1, legacy VTK; by other programs: surfaces (STL, OBJ, PLY, OFF, VTK), VTU, "
                  "XDMF, XML, "
                  "Medit, Abaqus, other Gmsh")
      ->required();
  app->add_option(
         "--edge", options->edge,
         "of a surface: edge of the tetrahedra that fill it, in the file's unit; 0: a 20th of its diagonal")
      ->check(CLI::NonNegativeNumber);
  app->add_option("--unit", options->unit, "the file's unit; what is written is in metres")
      ->check(CLI::IsMember(std::vector<std::string>(mesh_units.begin(), mesh_units.end())))
      ->capture_default_str();
  app->add_option(
      "--fix", options->fix,
      "write the mesh, tetrahedra turned right side out, duplicate and unused nodes gone; .msh or .vtk");
  app->add_flag("--keep-duplicates", options->keep_duplicates, "nodes at one place stay apart, as in a slit");
  app->add_option("--scene", options->scene, "write a scene that runs, its mesh beside it as OUT_mesh.msh");
  app->add_flag("--blade", options->blade,
                "the scene's instrument is a blade that cuts, not a tip that removes");
  app->add_option("--json", options->json, "figures to this file");
  add_force_option(*app, options->force);
  app->footer(
      "Example: haptic mesh liver.stl --unit mm --scene liver.yaml\n"
      "Surfaces are filled by gmsh (apt install gmsh) or tetgen, other formats converted by meshio (apt "
      "install\n"
      "meshio-tools).\n"
      "Exit code 1: hapticd refuses the file as it stands, and nothing was written instead; or a body of its "
      "size.");
  return {app, [options] { return run(*options); }};
}

}  // namespace hapticd
