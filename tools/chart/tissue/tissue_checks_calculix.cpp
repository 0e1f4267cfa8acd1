// The same meshes and loads in CalculiX (Debian: calculix-ccx), with its four-node tetrahedron C3D4.
#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <stdexcept>

#include "tests/support/mesh_shapes.h"
#include "tools/chart/tissue/tissue_check.h"
#include "tools/chart/tissue/tissue_static.h"

extern char** environ;

namespace hapticd {

namespace {

namespace fs = std::filesystem;

std::string program() {
  std::stringstream path(std::getenv("PATH") ? std::getenv("PATH") : "");
  for (std::string folder; std::getline(path, folder, ':');)
    if (access((folder + "/ccx").c_str(), X_OK) == 0) return folder + "/ccx";
  return "";
}

struct ScratchFolder {
  fs::path path;
  ScratchFolder() {
    std::string name = (fs::temp_directory_path() / "tissue_ccx_XXXXXX").string();
    if (!mkdtemp(name.data())) throw std::runtime_error(name + ": cannot be made");
    path = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
};

void write_input(const fs::path& file, const TissueModel& model, const VecX& load, const Held& held) {
  std::ofstream out(file);
  out.precision(12);  // CalculiX reads twenty characters of a number, and drops an exponent that begins later
  out << "*NODE, NSET=NALL\n";
  for (int n = 0; n < model.node_count(); ++n) {
    const Vec3& x = model.mesh.nodes[n];
    out << n + 1 << ", " << x.x() << ", " << x.y() << ", " << x.z() << '\n';
  }
  out << "*ELEMENT, TYPE=C3D4, ELSET=EALL\n";
  for (int t = 0; t < model.tet_count(); ++t) {
    out << t + 1;
    for (const int n : model.mesh.tets[t]) out << ", " << n + 1;
    out << '\n';
  }
  out << "*MATERIAL, NAME=TISSUE\n*ELASTIC\n"
      << model.material.young << ", " << model.material.poisson
      << "\n*SOLID SECTION, ELSET=EALL, MATERIAL=TISSUE\n*BOUNDARY\n";
  for (const auto& [k, value] : held)
    out << k / 3 + 1 << ", " << k % 3 + 1 << ", " << k % 3 + 1 << ", " << value << '\n';
  out << "*STEP\n*STATIC\n*CLOAD\n";
  for (Eigen::Index k = 0; k < load.size(); ++k)
    if (load[k] != 0) out << k / 3 + 1 << ", " << k % 3 + 1 << ", " << load[k] << '\n';
  out << "*NODE PRINT, NSET=NALL\nU\n*END STEP\n";
}

VecX read_displacements(const fs::path& file, int nodes) {
  std::ifstream in(file);
  VecX u = VecX::Constant(3 * nodes, NAN);
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    int node = 0;
    double x = 0, y = 0, z = 0;
    if (words >> node >> x >> y >> z && node >= 1 && node <= nodes)
      u.segment<3>(3 * (node - 1)) = Vec3(x, y, z);
  }
  if (!u.allFinite()) throw std::runtime_error("CalculiX left no displacements");
  return u;
}

VecX by_calculix(const std::string& ccx, const TissueModel& model, const VecX& load, const Held& held) {
  const ScratchFolder folder;
  const std::string job = (folder.path / "tissue").string();
  write_input(job + ".inp", model, load, held);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, (job + ".log").c_str(), O_WRONLY | O_CREAT, 0600);
  posix_spawn_file_actions_addchdir_np(&actions, folder.path.c_str());  // its solver writes where it stands
  std::string words[] = {ccx, "-i", job};
  char* argv[] = {words[0].data(), words[1].data(), words[2].data(), nullptr};
  pid_t child = 0;
  int status = 0;
  const bool ran = posix_spawn(&child, argv[0], &actions, nullptr, argv, environ) == 0 &&
                   waitpid(child, &status, 0) == child && WIFEXITED(status);
  posix_spawn_file_actions_destroy(&actions);
  if (!ran) throw std::runtime_error("CalculiX did not run");
  return read_displacements(job + ".dat", model.node_count());
}

// Displacements over the largest: what is left is CalculiX's seven printed digits.
double difference(const VecX& ours, const VecX& theirs) {
  return (ours - theirs).cwiseAbs().maxCoeff() / theirs.cwiseAbs().maxCoeff();
}

void compare(const std::string& ccx, const std::string& name, const TissueModel& model, const VecX& load,
             const Held& held, TissueFindings& findings) {
  findings.check("CalculiX, " + name + ": largest difference of displacement over the largest", 0,
                 difference(solve_linear(model, load, held), by_calculix(ccx, model, load, held)), 1e-6,
                 "CalculiX 2.20, C3D4, same mesh and loads");
}

// Loaded at every node of the far end, held at the other.
void compare_box(const std::string& ccx, const std::string& name, int cells, double poisson,
                 TissueFindings& findings) {
  const Vec3 size(3e-2, 1e-2, 1e-2);
  TetMesh mesh = box_mesh(size, 3 * cells, cells, cells);
  jitter_interior(mesh, size, 0.25 * size.z() / cells, 7);
  const TissueModel model = make_tissue_model(std::move(mesh), {3000, poisson, 1000, 0, 0}, {}, Vec3::Zero());
  Held held;
  for (int axis = 0; axis < 3; ++axis)
    hold(
        model, axis, [](const Vec3& x) { return x.x() < 1e-9; }, held);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1e-6, 1e-6);
  VecX load =
      surface_load(model, Vec3(0.5, -0.3, -0.1), [&](const Vec3& x) { return x.x() > size.x() - 1e-9; });
  for (int n = 0; n < model.node_count(); ++n)
    if (model.mesh.nodes[n].x() > 1e-9)
      for (int axis = 0; axis < 3; ++axis) load[3 * n + axis] += uniform(random);
  compare(ccx, name, model, load, held, findings);
}

}  // namespace

void check_calculix(Effort effort, TissueFindings& findings) {
  const std::string ccx = program();
  if (ccx.empty()) {
    findings.skipped.push_back("calculix: no ccx on the path (Debian: calculix-ccx)");
    return;
  }
  compare_box(ccx, "irregular bar, ν = 0.3", 4, 0.3, findings);
  compare_box(ccx, "irregular bar, ν = 0.45", 4, 0.45, findings);
  if (effort == Effort::full)
    compare_box(ccx, "irregular bar of 18 000 tetrahedra, ν = 0.499", 10, 0.499, findings);
}

}  // namespace hapticd
