// Shipped scenes are read; every fault a person can make is named with file, line and key.
#include "server/scene/scene_reader.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "server/record/trajectory_reader.h"
#include "server/scene/scene_describe.h"
#include "tests/server/scene/scene_file.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;

const fs::path scenes = fs::path(SOURCE_DIR) / "config/scenes";

const std::string good_scene = R"(scene: test
simulation:
  rate: 50
  contact: renewed
  alarm_distance: 0.1
  sample_spacing: 0.05
)" + block_of_tissue + R"(instrument:
  tip: ball
  primitives:
    - name: ball
      shape: sphere
      radius: 0.1
    - name: stick
      shape: cylinder
      radius: 0.05
      length: 1
  coupling:
    stiffness: 100
    rotational_stiffness: 1
    damping_time: 0.002
removal:
  rate: 20
device: touch
mapping:
  position_scale: 1
  force_scale: 1
trajectory: move.csv
)";

class SceneReader : public SceneFile {
 protected:
  SceneReader() : SceneFile(good_scene) {}
};

TEST_F(SceneReader, GoodSceneIsRead) {
  const Scene scene = read(good_scene);
  ASSERT_EQ(scene.bodies.size(), 1u);
  EXPECT_EQ(scene.bodies[0].fixed_nodes, scene.bodies[0].mesh.group("bottom")->nodes);
  EXPECT_EQ(scene.bodies[0].material.young, 3000);
  EXPECT_EQ(scene.first().shape.primitives[1].half_length, 0.5);
  EXPECT_EQ(scene.first().shape.tip, 0);
  EXPECT_EQ(scene.first().removal.rate, 20);
  EXPECT_EQ(scene.first().device.max_force, 3.3);
  EXPECT_EQ(scene.first().device_name, "Touch");
  EXPECT_EQ(felt_stiffness(scene.first()), 100);
  EXPECT_EQ(read(good_scene, "falcon").first().device.max_force, 8);
}

// Of the seventeenth body on, haptic_options would leave it out without a word.
TEST_F(SceneReader, ABodyWhoseViscosityWouldNotBeFeltIsRefused) {
  const auto scene = [&](int others, const std::string& stiffness) {
    std::string bodies;
    for (int i = 0; i < others; ++i)
      bodies += "  - name: wall" + std::to_string(i) + "\n    kind: rigid\n    mesh: tiny_41_ascii.msh\n";
    bodies +=
        "  - name: last\n    kind: deformable\n    mesh: tiny_41_ascii.msh\n    fixed: bottom\n    "
        "material:\n";
    bodies += "      {young: 3000, poisson: 0.45, density: 1000, rayleigh: {stiffness: " + stiffness + "}}\n";
    return with(good_scene, "instrument:\n", bodies + "instrument:\n");
  };
  const Scene sixteen = read(scene(14, "1e-3"));
  ASSERT_EQ(sixteen.bodies.size(), 16u);
  EXPECT_EQ(sixteen.bodies[15].material.rayleigh_stiffness, 1e-3);
  EXPECT_EQ(read(scene(15, "0")).bodies.size(), 17u);
  try {
    read(scene(15, "1e-3"));
    ADD_FAILURE() << "was accepted";
  } catch (const InputError& e) {
    EXPECT_EQ(e.key(), "bodies[16].material");
    EXPECT_NE(std::string(e.what()).find("first 16 bodies"), std::string::npos) << e.what();
  }
}

TEST_F(SceneReader, ModelsAreChosenOnlyWhereTheSceneSaysSo) {
  const Scene plain = read(good_scene);
  EXPECT_FALSE(plain.plans);
  EXPECT_TRUE(plain.bodies[0].corotational && plain.bodies[0].dynamic && plain.bodies[0].simulated);

  const Scene planned = read("model: auto\naccuracy: 0.05\n" + good_scene);
  EXPECT_TRUE(planned.plans);
  EXPECT_EQ(planned.accuracy, 0.05);
  EXPECT_TRUE(planned.pinned_contact);  // it stands there
  EXPECT_FALSE(planned.pinned_compliance || planned.bodies[0].pinned_elements);

  const Scene pinned = read("model: {elements: linear, motion: static, friction: false}\n" + good_scene);
  EXPECT_TRUE(pinned.plans && pinned.bodies[0].pinned_elements && !pinned.bodies[0].corotational);
  EXPECT_TRUE(pinned.bodies[0].dynamic);  // it can be cut
  EXPECT_FALSE(pinned.friction);

  expect_fault("scene: test", "scene: test\nmodel: automatic", "model", "auto");
  expect_fault("scene: test", "scene: test\naccuracy: 0", "accuracy", "above 0");
  expect_fault("removable: true", "removable: true\n    motion: static", "bodies[0].motion", "held");
  expect_fault("removable: true", "removable: true\n    elements: elastic", "bodies[0].elements", "linear");
}

TEST_F(SceneReader, LawAndCappedPoissonRatio) {
  EXPECT_EQ(read(good_scene).bodies[0].material.law, Law::corotational);
  const Scene scene =
      read(with(good_scene, "poisson: 0.45", "poisson: 0.49\n      poisson_cap: 0.45\n      law: guarded"));
  const Material& m = scene.bodies[0].material;
  EXPECT_EQ(m.law, Law::guarded);
  EXPECT_EQ(m.poisson, 0.45);
  EXPECT_NEAR(m.young / (1 - 0.45 * 0.45), 3000 / (1 - 0.49 * 0.49), 1e-9);
  expect_fault("poisson: 0.45", "poisson: 0.45\n      law: rubber", "bodies[0].material.law", "guarded");
}

TEST_F(SceneReader, UnknownKeys) {
  expect_fault("  rate: 50", "  raet: 50", "simulation.raet", "did you mean 'rate'?");
  expect_fault("removable: true", "removeable: true", "bodies[0].removeable", "did you mean 'removable'?");
  expect_fault("young: 3000", "young: 3000\n      zebra: 1", "bodies[0].material.zebra", "known here: young");
  expect_fault("device: touch", "devise: touch", "devise", "did you mean 'device'?");
  expect_fault("    stiffness: 100", "    stiffnes: 100", "instrument.coupling.stiffnes", "did you mean");
  expect_fault("  rate: 50", "  rate: 50\n  rate: 60", "simulation.rate", "given twice");
}

TEST_F(SceneReader, ValuesOutOfRange) {
  expect_fault("young: 3000", "young: -3000", "bodies[0].material.young", "must be at least 1");
  expect_fault("young: 3000", "young: 3 kPa", "bodies[0].material.young", "not a number");
  expect_fault("young: 3000", "young: .nan", "bodies[0].material.young", "finite");
  expect_fault("poisson: 0.45", "poisson: 0.5", "bodies[0].material.poisson", "below 0.5");
  expect_fault("poisson: 0.45", "poisson: -1", "bodies[0].material.poisson", "above -1");
  expect_fault("density: 1000", "density: 0", "bodies[0].material.density", "above 0");
  expect_fault("  rate: 50", "  rate: 5000", "simulation.rate", "at most 500");
  expect_fault("  rate: 20", "  rate: -1", "removal.rate", "at least 0");
  expect_fault("alarm_distance: 0.1", "alarm_distance: 0", "simulation.alarm_distance", "above 0");
  expect_fault("radius: 0.1", "radius: 0", "instrument.primitives[0].radius", "above 0");
  expect_fault("force_scale: 1", "force_scale: -1", "mapping.force_scale", "above 0");
  expect_fault("force_scale: 1", "force_scale: 1\n  frame: [0, 0, 0, 2]", "mapping.frame",
               "not a unit quaternion");
  expect_fault("contact: renewed", "contact: fresh", "simulation.contact", "renewed, frozen");
  expect_fault("kind: deformable", "kind: soft", "bodies[0].kind", "deformable, rigid");
  expect_fault("shape: sphere", "shape: ball", "instrument.primitives[0].shape", "sphere, capsule");
}

TEST_F(SceneReader, MissingThings) {
  expect_fault("mesh: tiny_41_ascii.msh", "mesh: none.msh", "bodies[0].mesh", "no such file");
  expect_fault("mesh: tiny_41_ascii.msh", "mesh: " + std::string(5000, 'n') + ".msh", "bodies[0].mesh",
               "no such file");
  expect_fault("device: touch", "device: tuch", "device", "did you mean 'touch'?");
  expect_fault("trajectory: move.csv", "trajectory: none.csv", "trajectory", "no such file");
  expect_fault("trajectory: move.csv", "trajectory: " + std::string(5000, 'n') + ".csv", "trajectory",
               "no such file");
  expect_fault("tip: ball", "tip: bull", "instrument.tip", "ball, stick");
  expect_fault("fixed: bottom", "fixed: botom", "bodies[0].fixed", "did you mean 'bottom'?");
  expect_fault("    fixed: bottom\n", "", "bodies[0].fixed", "floating: true", 8);
  expect_fault("      density: 1000\n", "", "bodies[0].material.density", "is missing", 14);
  expect_fault("  rate: 20", "  rate:", "removal.rate", "has no value");
  expect_fault("    removable: true\n", "", "removal", "no body is removable", 30);
  EXPECT_TRUE(read(with(good_scene, "fixed: bottom", "floating: true")).bodies[0].fixed_nodes.empty());
}

// A second body, and a list of contacts in front of the instrument.
TEST_F(SceneReader, ContactsBetweenBodies) {
  const std::string two = with(good_scene, "instrument:\n",
                               "  - name: wall\n    kind: rigid\n    mesh: tiny_41_ascii.msh\n"
                               "contacts:\n  - between: [block, wall]\n    friction: 0.3\ninstrument:\n");
  const Scene scene = read(two);
  ASSERT_EQ(scene.contacts.size(), 1u);
  EXPECT_EQ(scene.contacts[0].points, 0);
  EXPECT_EQ(scene.contacts[0].faces, 1);
  EXPECT_EQ(scene.contacts[0].friction, 0.3);
  EXPECT_NE(describe(scene).find("nodes of block on faces of wall"), std::string::npos);

  const auto refused = [&](const std::string& old, const std::string& replacement, const std::string& key,
                           const std::string& words) {
    SCOPED_TRACE(replacement);
    try {
      read(with(two, old, replacement));
      ADD_FAILURE() << "was accepted";
    } catch (const InputError& e) {
      EXPECT_EQ(e.key(), key);
      EXPECT_GE(e.line(), 20) << e.what();
      EXPECT_NE(std::string(e.what()).find(words), std::string::npos) << e.what();
    }
  };
  refused("[block, wall]", "[block, wal]", "contacts[0].between", "did you mean 'wall'?");
  refused("[block, wall]", "block", "contacts[0].between", "two bodies");
  refused("[block, wall]", "[wall, wall]", "contacts[0].between", "neither");
  refused("friction: 0.3", "friction: -0.3", "contacts[0].friction", "");
  refused("friction: 0.3", "frictoin: 0.3", "contacts[0].frictoin", "friction");
  refused("friction: 0.3\n", "friction: 0.3\n  - between: [block, wall]\n", "contacts[1].between", "already");
}

TEST_F(SceneReader, FaultsOfOtherFilesNameThose) {
  const auto fault_of = [&](const std::string& text) -> std::string {
    try {
      read(text);
    } catch (const InputError& e) {
      return e.file().filename().string() + ":" + std::to_string(e.line()) + ":" + e.key() + ": " + e.what();
    }
    return "none";
  };
  write("move.csv", "t,px,py,pz\n0,0,0,2\n1,zero,0,3\n");
  EXPECT_TRUE(fault_of(good_scene).starts_with("move.csv:3:column px: "));
  write("move.csv", "t,px,py,pz\n0,0,0,2\n1,0,0,3\n");

  write("bad.msh",
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n$EndNodes\n"
        "$Elements\n1\n1 4 2 1 1 1 3 2 4\n$EndElements\n");
  const std::string inverted = fault_of(with(good_scene, "tiny_41_ascii.msh", "bad.msh"));
  EXPECT_TRUE(inverted.starts_with("bad.msh:13:$Elements: ")) << inverted;
  EXPECT_NE(inverted.find("inverted"), std::string::npos);

  write("weak.yaml",
        "device: Weak\nmax_force: 1\nmax_force_rate: 10\nmax_speed: 1\nworkspace_radius: 0.1\n"
        "max_stiffness: -5\ndamping: 1\n");
  EXPECT_TRUE(fault_of(with(good_scene, "device: touch", "device: weak.yaml"))
                  .starts_with("weak.yaml:6:max_stiffness"));

  EXPECT_TRUE(fault_of("scene: [\n").starts_with("scene.yaml:2:YAML"));
  EXPECT_TRUE(fault_of("just words\n").starts_with("scene.yaml:1:"));
  EXPECT_THROW(read_scene(folder_ / "absent.yaml"), InputError);
}

TEST_F(SceneReader, APieceThatNothingHoldsIsRefused) {
  // Two separate tetrahedra; the group holds one.
  write("two.msh",
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n0 1 "
        "\"bottom\"\n$EndPhysicalNames\n$Nodes\n8\n"
        "1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 9 0 0\n6 10 0 0\n7 9 1 0\n8 9 0 1\n$EndNodes\n$Elements\n3\n"
        "1 4 2 0 1 1 2 3 4\n2 4 2 0 1 5 6 7 8\n3 15 2 1 1 1\n$EndElements\n");
  EXPECT_THROW(read(with(good_scene, "tiny_41_ascii.msh", "two.msh")), InputError);
}

TEST_F(SceneReader, MillimetresAndAxes) {
  const Scene mm = read(with(good_scene, "    removable", "    mesh_unit: mm\n    removable"));
  EXPECT_NEAR(mm.bodies[0].mesh.nodes[0].norm(), 1e-3 * read(good_scene).bodies[0].mesh.nodes[0].norm(),
              1e-18);
  const Scene axis = read(with(good_scene, "      length: 1", "      from: [0, 0, 1]\n      to: [0, 2, 1]"));
  const Primitive& stick = axis.first().shape.primitives[1];
  EXPECT_EQ(stick.half_length, 1);
  EXPECT_LT((stick.placement.to_world(Vec3(0, 0, 1)) - Vec3(0, 2, 1)).norm(), 1e-12);
  const Scene convex = read(with(good_scene, "      shape: cylinder\n      radius: 0.05\n      length: 1",
                                 "      shape: convex\n      mesh: tiny_41_ascii.msh"));
  EXPECT_EQ(convex.first().shape.primitives[1].planes.size(), 6u);
  expect_fault("      length: 1", "      length: 1\n      from: [0, 0, 0]\n      to: [0, 0, 1]",
               "instrument.primitives[1].length", "beside from", 26);
}

TEST_F(SceneReader, ComplianceIsOneOfTheDaemonsMethods) {
  EXPECT_EQ(read(good_scene).compliance, ComplianceMethod::exact);
  const Scene scene = read(with(good_scene, "  rate: 50\n", "  rate: 50\n  compliance: zone\n"));
  EXPECT_EQ(scene.compliance, ComplianceMethod::zone);
  EXPECT_NE(describe(scene).find("compliance zone"), std::string::npos);
  expect_fault("rate: 50", "rate: 50\n  compliance: dense", "simulation.compliance", "exact");
}

TEST(ShippedScenes, AreReadAndFitTheirDevice) {
  for (const char* name :
       {"cataract/cataract.yaml", "cube/cube.yaml", "lens_large/lens_5k.yaml", "lens_large/lens_20k.yaml"}) {
    SCOPED_TRACE(name);
    const Scene scene = read_scene(scenes / name);
    EXPECT_LE(felt_stiffness(scene.first()), 1.001 * scene.first().device_stiffness);
    ASSERT_TRUE(scene.first().trajectory);
    const std::string plan = describe(scene);
    for (const SceneBody& body : scene.bodies) EXPECT_NE(plan.find(body.name + ":"), std::string::npos);
    EXPECT_EQ(plan.find("MORE"), std::string::npos);
    // The trajectory begins clear of everything and ends clear of everything.
    const Trajectory trajectory = read_trajectory(*scene.first().trajectory, LengthUnit::metre);
    for (double t : {trajectory.begin(), trajectory.end()})
      for (const SceneBody& body : scene.bodies)
        for (const Vec3& x : body.mesh.nodes)
          ASSERT_GT(gap_at(scene.first().shape, to_scene(scene.first().device, sample_at(trajectory, t)), x)
                        .distance,
                    0);
    double speed = 0;
    for (double t = trajectory.begin(); t < trajectory.end(); t += 1e-3)
      speed = std::max(speed, (sample_at(trajectory, t + 1e-3).p - sample_at(trajectory, t).p).norm() / 1e-3);
    EXPECT_LT(speed, 0.5 * scene.first().device.max_speed);
    EXPECT_LT(speed * scene.first().device.position_scale / scene.rate, scene.alarm_distance);
  }
}

TEST(ShippedScenes, TheShaftStaysWithinTheIncision) {
  const Scene scene = read_scene(scenes / "cataract/cataract.yaml");
  const Trajectory trajectory = read_trajectory(*scene.first().trajectory, LengthUnit::metre);
  const SceneBody& cornea = scene.bodies[2];
  ASSERT_EQ(cornea.name, "cornea");
  const double radius = 7.525e-3, y = -4.2e-3;
  const Vec3 incision(0, y, -1.9e-3 + std::sqrt(radius * radius - y * y));
  for (double t = trajectory.begin(); t <= trajectory.end(); t += 0.1) {
    const Pose X = to_scene(scene.first().device, sample_at(trajectory, t));
    const Vec3 local = X.to_local(incision);
    EXPECT_LT(local.head<2>().norm(), 20e-6) << t;
    EXPECT_GT(local.z(), 1e-3) << t;
    for (const Vec3& x : cornea.mesh.nodes)
      ASSERT_GT(gap_at(scene.first().shape, X, x).distance, 0.3e-3) << t;
  }
}

TEST(ShippedScenes, TheLensHasItsPublishedSize) {
  const Scene scene = read_scene(scenes / "cataract/cataract.yaml");
  const SceneBody& lens = scene.bodies[0];
  EXPECT_NEAR(double(lens.mesh.nodes.size()), 1113, 0.01 * 1113);
  EXPECT_NEAR(double(lens.mesh.tets.size()), 4862, 0.01 * 4862);
  EXPECT_GT(lens.fixed_nodes.size(), 20u);
  for (int n : lens.fixed_nodes) {
    EXPECT_GT(lens.mesh.nodes[n].head<2>().norm(), 4.3e-3);
    EXPECT_LT(std::abs(lens.mesh.nodes[n].z()), 0.45e-3);
  }
  const SceneBody& capsule = scene.bodies[1];
  EXPECT_LE(capsule.mesh.nodes.size(), 450u);
  for (int n : capsule.fixed_nodes) EXPECT_LT(std::abs(capsule.mesh.nodes[n].z()), 0.1e-3);
}

}  // namespace
}  // namespace hapticd
