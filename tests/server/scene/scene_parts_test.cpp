#include "server/scene/scene_parts.h"

#include "server/mesh/mesh_reader.h"
#include "server/mesh/mesh_writer.h"
#include "server/observe/body_snapshot.h"
#include "server/scene/scene_describe.h"
#include "server/scene/scene_world.h"
#include "server/schedule/scene_fingerprint.h"
#include "tests/server/scene/scene_file.h"
#include "tests/support/mesh_shapes.h"

namespace hapticd {
namespace {

const std::string sound_scene = R"(scene: parts
simulation:
  rate: 50
  alarm_distance: 0.002
  sample_spacing: 0.001
bodies:
  - name: block
    kind: deformable
    mesh: bar.msh
    fixed: bottom
    material:
      young: 3000
      poisson: 0.4
      density: 1000
instrument:
  tip: tip
  primitives:
    - {name: tip, shape: sphere, radius: 0.002}
  coupling: {stiffness: 100, rotational_stiffness: 0.01, damping_time: 0.002}
device: touch
mapping: {position_scale: 1, force_scale: 1}
)";

class SceneParts : public SceneFile {
 protected:
  SceneParts() : SceneFile(sound_scene) {}
  void SetUp() override {
    SceneFile::SetUp();
    mesh = box_mesh({0.02, 0.01, 0.01}, 4, 2, 2);
    MeshGroup left{"left", {}, {}}, top{"top", {}, {}};
    for (int t = 0; t < 48; ++t) left.tets.push_back(t);
    for (std::size_t n = 0; n < mesh.nodes.size(); ++n)
      if (mesh.nodes[n].z() > 0.0099) top.nodes.push_back(static_cast<int>(n));
    for (const int t : left.tets)
      for (const int n : mesh.tets[t]) left.nodes.push_back(n);
    std::sort(left.nodes.begin(), left.nodes.end());
    left.nodes.erase(std::unique(left.nodes.begin(), left.nodes.end()), left.nodes.end());
    mesh.groups.push_back(left);
    mesh.groups.push_back(top);
    write_mesh_file(mesh, folder_ / "bar.msh");
  }
  Scene with_body(const std::string& keys) {
    return read(with(sound_, "    material:\n", keys + "    material:\n"));
  }

  // The forces of a tip that presses, step by step, in the axes of `seen`.
  static std::vector<Vec3> pressed(const Scene& scene, const Pose& seen, double scale) {
    const std::unique_ptr<World> world = make_world(scene);
    const auto problem = std::make_unique<CondensedProblem>();
    std::vector<Vec3> forces;
    for (int step = 0; step < 12; ++step) {
      InstrumentSample sample;
      sample.present = true;
      sample.pose = {seen.p + seen.q * (scale * Vec3(0.011, 0.005, 0.0125 - 2e-4 * step)), seen.q};
      InstrumentSamples samples;
      samples[0] = sample;
      const StepReport report = world->step([&] { return samples; }, *problem);
      forces.push_back(seen.q.conjugate() * Vec3(report.contact.wrench[0].head<3>()));
    }
    return forces;
  }

  TetMesh mesh;
};

TEST_F(SceneParts, APlacedBodyPressesAsOneThatWasWrittenThere) {
  const Pose there{{0.3, -0.2, 0.1}, Quat(0.5, 0.5, -0.5, 0.5)};
  const std::string keys =
      "    position: [0.3, -0.2, 0.1]\n    orientation: [0.5, -0.5, 0.5, 0.5]\n    scale: 1.5\n";
  TetMesh moved = mesh;
  for (Vec3& x : moved.nodes) x = there.p + there.q * (1.5 * x);
  write_mesh_file(moved, folder_ / "moved.msh");
  const std::vector<Vec3> placed = pressed(with_body(keys), there, 1.5),
                          written = pressed(read(with(sound_, "bar.msh", "moved.msh")), there, 1.5);
  double peak = 0;
  for (std::size_t i = 0; i < placed.size(); ++i) {
    peak = std::max(peak, written[i].norm());
    EXPECT_LT((placed[i] - written[i]).norm(), 1e-9) << i;
  }
  EXPECT_GT(peak, 1e-3);
  // Nor does it matter where it stands.
  const std::vector<Vec3> at_home = pressed(with_body("    scale: 1.5\n"), Pose{}, 1.5);
  for (std::size_t i = 0; i < placed.size(); ++i)
    EXPECT_LT((placed[i] - at_home[i]).norm(), 1e-3 * peak) << i;
}

TEST_F(SceneParts, PlacementsThatMakeNoSenseAreRefused) {
  const auto fault = [&](const std::string& key, const std::string& value, const std::string& words) {
    expect_fault("    fixed: bottom\n", "    fixed: bottom\n    " + key + ": " + value + "\n",
                 "bodies[0]." + key, words, 11);
  };
  fault("scale", "0", "1: the mesh as it is");
  fault("scale", "-1", "mirrored");
  fault("position", "[0, 0, 1000]", "metres");
  fault("position", "[0, 0]", "three");
  fault("orientation", "[1, 1, 1, 1]", "unit");
}

TEST_F(SceneParts, ARegionHasAMaterialOfItsOwn) {
  const Scene scene = with_body("    regions:\n      - {group: left, young: 9000, stretch: [1.1, 1, 1]}\n");
  ASSERT_EQ(scene.bodies[0].regions.size(), 1u);
  const TissueRegion& region = scene.bodies[0].regions[0];
  EXPECT_EQ(region.tets.size(), 48u);
  EXPECT_EQ(region.material.young, 9000);
  EXPECT_EQ(region.material.poisson, 0.4);
  EXPECT_EQ(region.material.density, 1000);
  EXPECT_EQ(region.stretch, Vec3(1.1, 1, 1));
  // The whole body's stretch is that of the rest.
  const Scene all =
      with_body("    stretch: [1.2, 1.2, 1.2]\n    regions:\n      - {group: left, young: 9000}\n");
  ASSERT_EQ(all.bodies[0].regions.size(), 2u);
  EXPECT_EQ(all.bodies[0].regions[0].stretch, Vec3(1.2, 1.2, 1.2));
  EXPECT_EQ(all.bodies[0].regions[1].tets.size(), mesh.tets.size() - 48);
}

TEST_F(SceneParts, SpringsHoldByNodeOrByArea) {
  const Scene scene =
      read(with(with(sound_, "    fixed: bottom\n", ""), "    material:\n",
                "    springs:\n      - {group: top, stiffness: 2, rest_offset: [0, 0, 1.0e-3]}\n"
                "      - {group: bottom, stiffness_per_area: 1.0e5}\n    material:\n"));
  const SceneBody& body = scene.bodies[0];
  EXPECT_TRUE(body.fixed_nodes.empty());
  double top = 0, bottom = 0;
  for (std::size_t n = 0; n < body.springs.size(); ++n) {
    const NodeSpring& spring = body.springs[n];
    if (body.mesh.nodes[n].z() > 0.0099) {
      top += spring.stiffness;
      EXPECT_NEAR(spring.anchor.z(), 0.011, 1e-12);
    } else {
      bottom += spring.stiffness;
    }
  }
  EXPECT_NEAR(top, 2.0 * 15, 1e-9);
  EXPECT_NEAR(bottom, 1e5 * 2e-4, 1e-9);
}

TEST_F(SceneParts, WhatIsFarIsCondensed) {
  const Scene scene = with_body("    near: {centre: [0.01, 0.005, 0.01], radius: 6.0e-3}\n");
  ASSERT_TRUE(scene.bodies[0].near);
  EXPECT_EQ(scene.bodies[0].near->centre, Vec3(0.01, 0.005, 0.01));
  EXPECT_NE(describe(scene).find("simulated within 6 mm of (10, 5, 10) mm"), std::string::npos);
  const Scene all = with_body("");
  EXPECT_NE(fingerprint(scene), fingerprint(all));
  const auto world = make_world(scene);
  ASSERT_TRUE(world->bodies()[0].model.condensed);
  EXPECT_LT(std::count(world->bodies()[0].state.alive.begin(), world->bodies()[0].state.alive.end(), 1),
            static_cast<std::ptrdiff_t>(scene.bodies[0].mesh.tets.size()));
  // What looks on sees all of it.
  BodySnapshot seen, whole;
  take_snapshot(world->bodies()[0], seen);
  take_snapshot(make_world(all)->bodies()[0], whole);
  EXPECT_EQ(seen.alive, whole.alive);
}

TEST_F(SceneParts, FaultsOfNearRegionsAreNamed) {
  const auto fault = [&](const std::string& text, const std::string& key, const std::string& words,
                         int line) {
    expect_fault("    fixed: bottom\n", "    fixed: bottom\n" + text, key, words, line);
  };
  fault("    near: {centre: [0, 0, 0]}\n", "bodies[0].near.radius", "missing", 11);
  fault("    near: {centre: [0, 0, 0], radius: -1}\n", "bodies[0].near.radius", "above 0", 11);
  fault("    near: {centre: [1, 1, 1], radius: 0.01}\n", "bodies[0].near.centre", "no tetrahedron", 11);
  fault("    near: {centre: [0, 0, 0], radius: 0.01}\n    toughness: 100\n    max_new_nodes: 10\n",
        "bodies[0].toughness", "cannot stand beside near", 12);
  expect_fault("    fixed: bottom\n", "    floating: true\n    near: {centre: [0, 0, 0], radius: 0.01}\n",
               "bodies[0].floating", "cannot stand beside near", 10);
}

TEST_F(SceneParts, FaultsOfRegionsAndSpringsAreNamed) {
  const auto fault = [&](const std::string& text, const std::string& key, const std::string& words,
                         int line) {
    expect_fault("    fixed: bottom\n", "    fixed: bottom\n" + text, key, words, line);
  };
  fault("    regions:\n      - {group: right}\n", "bodies[0].regions[0].group",
        "its groups: left, bottom, top", 12);
  fault("    regions:\n      - {group: top}\n", "bodies[0].regions[0].group", "no tetrahedra", 12);
  fault("    regions:\n      - {group: left}\n      - {group: left}\n", "bodies[0].regions[1].group",
        "another region", 13);
  fault("    regions:\n      - {group: left, poisson: 0.5}\n", "bodies[0].regions[0].poisson", "below 0.5",
        12);
  fault("    stretch: [3, 1, 1]\n", "bodies[0].stretch", "between 0.5 and 2", 11);
  fault("    springs:\n      - {group: top}\n", "bodies[0].springs[0].stiffness", "stiffness_per_area", 12);
  fault("    springs:\n      - {group: top, stiffness: -1}\n", "bodies[0].springs[0].stiffness", "above 0",
        12);
  fault("    springs:\n      - {group: top, stiffness: 1}\n      - {group: top, stiffness: 1}\n",
        "bodies[0].springs[1].group", "another entry", 13);
  fault("    springs:\n      - {group: top, stiffness: 1}\n    motion: static\n", "bodies[0].motion",
        "springs", 13);
  fault("    toughness: 100\n    max_new_nodes: 10\n    stretch: [1.1, 1, 1]\n", "bodies[0].toughness",
        "cannot be cut", 11);
}

// The top's faces are 2 · 4 · 2; a cleft needs a group that has faces, and cracks that begin.
TEST_F(SceneParts, CleftsAreTheFacesOfTheirGroups) {
  const std::string torn = "    toughness: 1\n    max_new_nodes: 10\n    tearing: ";
  const SceneBody body = with_body(torn + "{begins: true, clefts: [top]}\n").bodies[0];
  EXPECT_TRUE(body.tearing.begins);
  EXPECT_EQ(body.tearing.radius, 0);
  EXPECT_EQ(std::count(body.tearing.clefts.begin(), body.tearing.clefts.end(), 1), 16);
  EXPECT_TRUE(with_body(torn + "{begins: true}\n").bodies[0].tearing.clefts.empty());
  for (const char* wrong :
       {"{clefts: [top], radius: 0.002}", "{begins: true, clefts: [tup]}", "{begins: false}"})
    EXPECT_THROW(with_body(torn + wrong + "\n"), InputError) << wrong;
}

}  // namespace
}  // namespace hapticd
