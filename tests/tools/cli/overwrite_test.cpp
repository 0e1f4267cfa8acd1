// No command writes over a file of a person's without --force: 2, the file, the option; and the file is as it
// was.
#include <gtest/gtest.h>

#include "server/files/paths.h"
#include "server/mesh/mesh_writer.h"
#include "tests/support/mesh_shapes.h"
#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

const std::string cube = SOURCE_DIR "/config/scenes/cube/cube.yaml";

std::string liver(const ScratchDirectory& scratch) {
  const std::string file = scratch.file("liver.msh");
  write_mesh_file(box_mesh({0.02, 0.02, 0.01}, 4, 4, 2), file);
  return file;
}

void expect_kept(const std::string& command, const std::string& file, const std::string& option) {
  const std::string before = read_bytes(file);
  const CommandResult result = run_command(BIN_DIR "/" + command);
  EXPECT_EQ(result.code, 2) << command << "\n" << result.output;
  for (const std::string& part : {file, option, std::string("--force")})
    EXPECT_NE(result.output.find(part), std::string::npos) << part << " in\n" << result.output;
  EXPECT_EQ(read_bytes(file), before) << command;
}

// README's recipe, where mesh and scene share a stem.
TEST(Overwrite, AMeshBecomesASceneOfTheSameStemAndStaysWhatItWas) {
  const ScratchDirectory scratch;
  const std::string mesh = liver(scratch), before = read_bytes(mesh), scene = scratch.file("liver.yaml");
  const CommandResult made = run_haptic("mesh " + mesh + " --scene " + scene);
  ASSERT_EQ(made.code, 0) << made.output;
  EXPECT_EQ(read_bytes(mesh), before);
  const std::string text = read_bytes(scene);
  EXPECT_NE(text.find("mesh: liver_mesh.msh"), std::string::npos) << text;
  EXPECT_NE(text.find("accuracy: 0.02"), std::string::npos) << text;
  EXPECT_NE(text.find("contact: renewed"), std::string::npos) << text;
  const CommandResult check = run_command(BIN_DIR "/hapticd " + scene + " --check");
  EXPECT_EQ(check.code, 0) << check.output;
  EXPECT_NE(check.output.find("pinned by the scene"), std::string::npos) << check.output;

  // What a person has since put into it is not lost either, nor is the mesh beside it.
  expect_kept("haptic mesh " + mesh + " --scene " + scene, scene, "--scene");
  std::filesystem::remove(scene);
  expect_kept("haptic mesh " + mesh + " --scene " + scene, scratch.file("liver_mesh.msh"), "--scene");
  EXPECT_FALSE(std::filesystem::exists(scene));
  EXPECT_EQ(run_haptic("mesh " + mesh + " --scene " + scene + " --force").code, 0);
}

TEST(Overwrite, TheInputAndFilesOfOtherKindsAreKept) {
  const ScratchDirectory scratch;
  const std::string mesh = liver(scratch);
  expect_kept("haptic mesh " + mesh + " --fix " + mesh, mesh, "--fix");
  expect_kept("haptic mesh " + mesh + " --json " + mesh, mesh, "--json");
  const std::string motion = scratch.file("motion.csv", "t,px,py,pz\n0,0,0,0.04\n0.05,0,0,0.04\n");
  const std::string play = "haptic replay " + motion + " --offline --scene " + cube;
  expect_kept(play + " --forces " + motion, motion, "--forces");
  expect_kept(play + " --json " + motion, motion, "--json");
  const std::string notes = scratch.file("notes/mine.txt");
  std::filesystem::create_directories(scratch.file("notes"));
  std::ofstream(notes) << "mine";
  expect_kept(play + " --vtk " + scratch.file("notes"), notes, "--vtk");
  expect_kept("haptic record --vtk " + scratch.file("notes"), notes, "--vtk");
  expect_kept("haptic chart economy --csv " + motion, motion, "--csv");
  const std::string picture = scratch.file("notes/warping_mine.png");
  std::ofstream(picture) << "mine";
  expect_kept("haptic chart warping --out " + scratch.file("notes"), picture, "--out");
  expect_kept("hapticd " + cube + " --json " + mesh, mesh, "--json");
  expect_kept("hapticd " + cube + " --record " + motion, motion, "--record");
  const std::string capture = scratch.file("notes/000001.contact");
  std::ofstream(capture) << "mine";
  expect_kept("hapticd " + cube + " --capture " + scratch.file("notes"), capture, "--capture");
}

// Outputs of repeated runs are replaced, unless one of them is what is played now.
TEST(Overwrite, ARepeatedRunReplacesItsOwnOutputs) {
  const ScratchDirectory scratch;
  const std::string motion = scratch.file("motion.csv", "t,px,py,pz\n0,0,0,0.04\n0.05,0,0,0.04\n");
  const std::string forces = scratch.file("forces.csv"), json = scratch.file("figures.json");
  const std::string outputs = " --offline --scene " + cube + " --forces " + forces + " --json " + json;
  for (int i = 0; i < 2; ++i) {
    const CommandResult run = run_haptic("replay " + motion + outputs);
    EXPECT_EQ(run.code, 0) << run.output;
  }
  expect_kept("haptic replay " + forces + outputs, forces, "--forces");
  EXPECT_EQ(run_haptic("replay " + forces + outputs + " --force").code, 0);
}

}  // namespace
}  // namespace hapticd
