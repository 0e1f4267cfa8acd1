// haptic mesh: a spoilt mesh is told apart, repaired, and becomes a scene that hapticd accepts.
#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>

#include "server/files/paths.h"
#include "server/mesh/mesh_reader.h"
#include "server/mesh/mesh_writer.h"
#include "tests/support/mesh_shapes.h"
#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

nlohmann::json json_of(const std::string& file) { return nlohmann::json::parse(std::ifstream(file)); }

TEST(MeshCommand, SaysWhatAMeshIsLike) {
  const ScratchDirectory scratch;
  const std::string json = scratch.file("mesh.json");
  const CommandResult result = run_haptic("mesh " SOURCE_DIR "/config/scenes/cube/cube.msh --json " + json);
  EXPECT_EQ(result.code, 0) << result.output;
  const nlohmann::json figures = json_of(json);
  EXPECT_EQ(figures["nodes"], 236);
  EXPECT_EQ(figures["tetrahedra"], 736);
  EXPECT_NEAR(figures["volume_m3"]["total"].get<double>(), 8e-6, 1e-12);
  EXPECT_EQ(figures["boundary"]["shells"], 1);
  EXPECT_NE(result.output.find("group bottom"), std::string::npos) << result.output;
}

// Inspection says what it can, and names the unit; nothing that it says is of a file that is gone.
TEST(MeshCommand, AMeshInAnotherUnitIsKnownByItsSize) {
  const ScratchDirectory scratch;
  for (const auto& [unit, metres] : {std::pair{"um", 1e-6}, {"km", 1e3}, {"mm", 1e-3}}) {
    TetMesh mesh = box_mesh(Vec3(0.02, 0.02, 0.01), 5, 5, 3);
    for (Vec3& x : mesh.nodes) x /= metres;
    const std::string file = scratch.file(std::string(unit) + ".vtk"), option = std::string("--unit ") + unit;
    write_mesh_file(mesh, file);
    const CommandResult seen = run_haptic("mesh " + file);
    EXPECT_EQ(seen.code, 1) << seen.output;
    EXPECT_NE(seen.output.find(option), std::string::npos) << seen.output;
    EXPECT_NE(seen.output.find("mean ratio"), std::string::npos) << seen.output;
    EXPECT_EQ(seen.output.find("haptic-mesh-"), std::string::npos) << seen.output;
    const CommandResult made = run_haptic("mesh " + file + " --scene " + scratch.file("a.yaml"));
    EXPECT_EQ(made.code, 2) << made.output;
    EXPECT_NE(made.output.find(option), std::string::npos) << made.output;
    EXPECT_EQ(run_haptic("mesh " + file + " " + option).code, 0);
  }
}

TEST(MeshCommand, ASpoiltMeshIsRefusedRepairedAndMadeAScene) {
  const ScratchDirectory scratch;
  TetMesh mesh = box_mesh({20, 20, 10}, 5, 5, 3);
  std::swap(mesh.tets[4][0], mesh.tets[4][1]);
  const std::string file = scratch.file("spoilt.vtk"), fixed = scratch.file("good.msh"),
                    scene = scratch.file("good.yaml"), other = scratch.file("stranger.yaml");
  write_mesh_file(mesh, file);

  const CommandResult refused = run_haptic("mesh " + file + " --unit mm");
  EXPECT_EQ(refused.code, 1) << refused.output;
  EXPECT_NE(refused.output.find("--fix"), std::string::npos) << refused.output;

  const CommandResult result = run_haptic("mesh " + file + " --unit mm --fix " + fixed + " --scene " + other);
  EXPECT_EQ(result.code, 0) << result.output;
  EXPECT_EQ(read_mesh_file(fixed).tets.size(), mesh.tets.size());
  const CommandResult check = run_command(BIN_DIR "/hapticd " + other + " --check");
  EXPECT_EQ(check.code, 0) << check.output;
  // The bottom comes back as bottom_1 from VTK, and holds it.
  EXPECT_NE(check.output.find("36 fixed nodes"), std::string::npos) << check.output;
}

// A stranger's meshes. Each becomes a scene that the daemon takes and that runs: the tip comes down on it for
// 0.1 s.
struct Stranger {
  const char* name;
  std::function<std::string(const ScratchDirectory&)> make;  // the file
  const char* options;
  bool met = true;  // by the tip, that comes down in the middle
};

std::string written(const TetMesh& mesh, const std::string& file) {
  write_mesh_file(mesh, file);
  return file;
}

// Big-endian numbers, as VTK's binary files have them.
template <typename T>
void put_big(std::string& out, T value) {
  const char* bytes = reinterpret_cast<const char*>(&value);
  for (std::size_t i = sizeof(T); i-- > 0;) out += bytes[i];
}

std::string binary_vtk(const TetMesh& mesh, const std::string& file) {
  std::string out = "# vtk DataFile Version 2.0\nfrom elsewhere\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS " +
                    std::to_string(mesh.nodes.size()) + " float\n";
  for (const Vec3& x : mesh.nodes)
    for (int i = 0; i < 3; ++i) put_big(out, static_cast<float>(x[i]));
  out += "\nCELLS " + std::to_string(mesh.tets.size()) + " " + std::to_string(5 * mesh.tets.size()) + "\n";
  for (const Tet& t : mesh.tets) {
    put_big(out, std::int32_t{4});
    for (const int n : t) put_big(out, std::int32_t{n});
  }
  out += "\nCELL_TYPES " + std::to_string(mesh.tets.size()) + "\n";
  for (std::size_t i = 0; i < mesh.tets.size(); ++i) put_big(out, std::int32_t{10});
  std::ofstream(file, std::ios::binary) << out + "\n";
  return file;
}

TetMesh joined(TetMesh a, const TetMesh& b, const Vec3& shift) {
  const int before = static_cast<int>(a.nodes.size());
  for (const Vec3& x : b.nodes) a.nodes.push_back(x + shift);
  for (Tet t : b.tets) {
    for (int& n : t) n += before;
    a.tets.push_back(t);
  }
  a.groups.clear();
  return a;
}

const std::vector<Stranger> strangers = {
    {"metres",
     [](const auto& s) {
       return written(box_mesh({0.02, 0.02, 0.01}, 5, 5, 3), s.file("a.msh"));
     },
     ""},
    {"millimetres_binary_vtk",
     [](const auto& s) {
       return binary_vtk(box_mesh({30, 20, 15}, 6, 4, 3), s.file("a.vtk"));
     },
     " --unit mm"},
    // Volumes and surfaces in many groups, one element in two of them, none that says what holds it.
    {"many_groups",
     [](const auto& s) {
       TetMesh mesh = box_mesh({0.04, 0.03, 0.02}, 4, 4, 4);
       mesh.groups.clear();
       const auto half = static_cast<int>(mesh.tets.size() / 2);
       MeshGroup left{"liver left", {}, {}}, right{"liver right", {}, {}}, skin{"skin", {}, {}};
       for (int e = 0; e < static_cast<int>(mesh.tets.size()); ++e)
         (e <= half ? left : right).tets.push_back(e);
       right.tets.insert(right.tets.begin(), half);
       for (int n = 0; n < static_cast<int>(mesh.nodes.size()); n += 2) skin.nodes.push_back(n);
       mesh.groups = {left, right, skin};
       return written(mesh, s.file("a.msh"));
     },
     ""},
    {"two_pieces_far_from_the_origin",
     [](const auto& s) {
       const TetMesh box = box_mesh({0.02, 0.02, 0.02}, 3, 3, 3);
       return written(joined(joined({}, box, {1.0, -2.0, 0.5}), box, {1.03, -2.0, 0.5}), s.file("a.msh"));
     },
     ""},
    // 40 by 40 by 1.
    {"flat",
     [](const auto& s) {
       return written(box_mesh({0.08, 0.08, 0.002}, 12, 12, 1), s.file("a.msh"));
     },
     ""},
    {"graded",
     [](const auto& s) {
       TetMesh mesh = box_mesh({1, 1, 1}, 6, 6, 6);
       for (Vec3& x : mesh.nodes) x = 0.05 * Vec3(x.x() * x.x(), x.y() * x.y() * x.y(), x.z());
       return written(mesh, s.file("a.vtk"));
     },
     ""},
    {"one_tetrahedron",
     [](const auto& s) {
       TetMesh mesh;
       mesh.nodes = {{0, 0, 0}, {0.01, 0, 0}, {0, 0.01, 0}, {0, 0, 0.01}};
       mesh.tets = {{0, 1, 2, 3}};
       return written(mesh, s.file("a.msh"));
     },
     "", false},
    {"twenty_thousand",
     [](const auto& s) {
       return written(box_mesh({0.06, 0.05, 0.04}, 16, 16, 13), s.file("a.msh"));
     },
     ""},
};

class StrangersMesh : public testing::TestWithParam<Stranger> {};

TEST_P(StrangersMesh, BecomesASceneThatRuns) {
  const ScratchDirectory scratch;
  const std::string scene = scratch.file("scene.yaml"), json = scratch.file("figures.json");
  const std::string mesh = GetParam().make(scratch);
  const CommandResult made = run_haptic("mesh " + mesh + GetParam().options + " --scene " + scene);
  ASSERT_EQ(made.code, 0) << made.output;
  EXPECT_NE(made.output.find("tip: sphere of"), std::string::npos) << made.output;
  const CommandResult check = run_command(BIN_DIR "/hapticd " + scene + " --check");
  EXPECT_EQ(check.code, 0) << check.output;

  // The device's origin is a radius above the top: 10 mm of the hand down is 0.05 diagonals of the scene.
  const std::string down = scratch.file("down.csv", "t,px,py,pz\n0,0,0,0\n0.1,0,0,-0.02\n");
  const CommandResult run = run_haptic("replay " + down + " --offline --scene " + scene + " --json " + json +
                                       " --forces " + scratch.file("f.csv"));
  ASSERT_EQ(run.code, 0) << run.output;
  const nlohmann::json figures = json_of(json);
  EXPECT_EQ(figures["not_finite"], 0);
  EXPECT_EQ(figures["force_peak_n"].get<double>() > 1e-4, GetParam().met);
  EXPECT_LE(figures["force_peak_n"].get<double>(), 3.3 * (1 + 1e-9));  // a Touch's most, to rounding
  const std::string forces = read_bytes(scratch.file("f.csv"));
  EXPECT_EQ(forces.find("nan"), std::string::npos);
  EXPECT_EQ(forces.find("inf"), std::string::npos);
}
INSTANTIATE_TEST_SUITE_P(Meshes, StrangersMesh, testing::ValuesIn(strangers),
                         [](const auto& test) { return std::string(test.param.name); });

TEST(MeshCommand, FaultsAreNamedByFileAndLine) {
  const ScratchDirectory scratch;
  const CommandResult missing = run_haptic("mesh " + scratch.file("none.msh"));
  EXPECT_EQ(missing.code, 2);
  EXPECT_NE(missing.output.find("none.msh"), std::string::npos);
  const CommandResult broken = run_haptic("mesh " + scratch.file("a.msh", "$MeshFormat\n2.2 0 8\nx\n"));
  EXPECT_EQ(broken.code, 2);
  EXPECT_NE(broken.output.find("a.msh:2"), std::string::npos) << broken.output;
  const CommandResult ending =
      run_haptic("mesh " SOURCE_DIR "/config/scenes/cube/cube.msh --fix " + scratch.file("cube.stl"));
  EXPECT_EQ(ending.code, 2);
  EXPECT_NE(ending.output.find(".msh"), std::string::npos) << ending.output;
}

}  // namespace
}  // namespace hapticd
