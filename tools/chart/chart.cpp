#include "tools/chart/chart.h"

#include <spawn.h>
#include <sys/wait.h>

#include <filesystem>
#include <stdexcept>

#include "server/files/input_error.h"
#include "server/files/output_file.h"
#include "server/files/paths.h"
#include "server/mesh/mesh_reader.h"

extern char** environ;

namespace hapticd {

const std::vector<std::string>& lens_names() {
  static const std::vector<std::string> names = {"1k", "5k", "20k"};
  return names;
}

TissueModel read_lens(const std::string& name, MeshRoom room) {
  const std::filesystem::path scenes = config_directory() / "scenes";
  const std::filesystem::path file =
      name == "1k" ? scenes / "cataract" / "lens.msh" : scenes / "lens_large" / ("lens_" + name + ".msh");
  TetMesh mesh = read_mesh_file(file);
  const MeshGroup* zonule = mesh.group("zonule");
  if (!zonule) throw InputError(file, 0, "", "has no group 'zonule'");
  const std::vector<int> fixed = zonule->nodes;
  return make_tissue_model(std::move(mesh), {3.0e3, 0.45, 1090, 2.0, 2.0e-3}, fixed, Vec3::Zero(), room);
}

void prepare_outputs(const std::string& stem, const std::string& header, const std::string& out, std::string& json,
                     std::string& csv, bool force) {
  const OutputRule rule(force);
  if (!out.empty()) {
    rule.require_figures_folder("--out", out, stem + ".json", stem);
    if (json.empty()) json = out + "/" + stem + ".json";
    if (csv.empty()) csv = out + "/" + stem + ".csv";
  }
  rule.require_figures("--json", json);
  rule.require_table("--csv", csv, header);
  if (!out.empty()) std::filesystem::create_directories(out);
  for (const std::string& file : {json, csv})
    if (const auto parent = std::filesystem::path(file).parent_path(); !parent.empty())
      std::filesystem::create_directories(parent);
}

int run_program(const std::vector<std::string>& words) {
  std::vector<std::string> copies = words;
  std::vector<char*> argv;
  for (std::string& word : copies) argv.push_back(word.data());
  argv.push_back(nullptr);
  pid_t child = 0;
  int status = 0;
  if (posix_spawn(&child, argv[0], nullptr, nullptr, argv.data(), environ) != 0 ||
      waitpid(child, &status, 0) != child || !WIFEXITED(status))
    return -1;
  return WEXITSTATUS(status);
}

std::filesystem::path script_file(const std::string& name) {
  const std::filesystem::path installed = config_directory() / "scripts" / name;
  return std::filesystem::exists(installed) ? installed : config_directory().parent_path() / "tools/plot" / name;
}

void draw(const std::string& script, const std::string& data, const std::string& picture) {
  const std::string file = script_file(script).string();
  if (!std::filesystem::exists(file)) throw std::runtime_error(file + ": not there, so nothing is drawn");
  if (run_program({"/usr/bin/python3", file, data, picture}) != 0)
    throw std::runtime_error(
        picture + ": could not be drawn: " + file +
        " says why above (it needs python3-matplotlib and python3-numpy); the figures are in " + data);
}

}  // namespace hapticd
