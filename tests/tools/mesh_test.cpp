// haptic mesh: a spoilt mesh is told apart, repaired, and becomes a scene that hapticd accepts.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "server/mesh_reader.h"
#include "server/mesh_writer.h"
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
