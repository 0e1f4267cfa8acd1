// Several instruments in one tissue: what a scene says of each, and every fault with file, line and key.
#include "server/scene/scene_instruments.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "server/scene/scene_describe.h"
#include "tests/server/scene/scene_file.h"

namespace hapticd {
namespace {

const std::string tissue = R"(scene: two hands
simulation:
  alarm_distance: 0.1
  sample_spacing: 0.05
)" + block_of_tissue;

const std::string two_hands = tissue + R"(instrument_friction: 0.3
instruments:
  - name: phaco
    tip: ball
    primitives:
      - name: ball
        shape: sphere
        radius: 0.1
    coupling:
      stiffness: 100
      rotational_stiffness: 1
      damping_time: 0.002
    removal:
      rate: 20
    device: touch
    mapping:
      position_scale: 0.5
      force_scale: 2
    trajectory: move.csv
  - name: chopper
    tip: hook
    primitives:
      - name: hook
        shape: sphere
        radius: 0.05
    coupling:
      stiffness: 50
      rotational_stiffness: 1
      damping_time: 0.001
    device: falcon
    id: 7
    mapping:
      position_scale: 0.25
      force_scale: 4
)";

class SceneInstruments : public SceneFile {
 protected:
  SceneInstruments() : SceneFile(two_hands) {}

  // An entry with all that is needed and nothing else, at id.
  static std::string entry(const std::string& name, int id) {
    return "  - {name: " + name + ", tip: t, primitives: [{name: t, shape: sphere, radius: 0.1}], " +
           "coupling: {stiffness: 10, rotational_stiffness: 1, damping_time: 0}, device: touch, id: " +
           std::to_string(id) + ", mapping: {position_scale: 1, force_scale: 1}}\n";
  }
};

TEST_F(SceneInstruments, EachHasItsOwnKeys) {
  const Scene scene = read(two_hands);
  ASSERT_EQ(scene.instruments.size(), 2u);
  EXPECT_EQ(scene.instrument_friction, 0.3);
  const SceneInstrument &phaco = scene.instruments[0], &chopper = scene.instruments[1];
  EXPECT_EQ(phaco.name, "phaco");
  EXPECT_EQ(phaco.shape.primitives[0].radius, 0.1);
  EXPECT_EQ(phaco.coupling.stiffness, 100);
  EXPECT_EQ(phaco.removal.rate, 20);
  EXPECT_EQ(phaco.device_name, "Touch");
  EXPECT_EQ(phaco.device.id, 0u);  // its file's
  EXPECT_EQ(phaco.device.force_scale, 2);
  EXPECT_EQ(phaco.trajectory, folder_ / "move.csv");
  EXPECT_EQ(chopper.name, "chopper");
  EXPECT_EQ(chopper.shape.primitives[0].radius, 0.05);
  EXPECT_EQ(chopper.coupling.damping_time, 0.001);
  EXPECT_EQ(chopper.removal.rate, 0);
  EXPECT_EQ(chopper.device_name, "Falcon");
  EXPECT_EQ(chopper.device.id, 7u);
  EXPECT_EQ(chopper.device.position_scale, 0.25);
  EXPECT_EQ(chopper.device.max_force, 8);
  EXPECT_FALSE(chopper.trajectory);
  EXPECT_EQ(felt_stiffness(chopper), 50);
  EXPECT_TRUE(has_device(scene, 0) && has_device(scene, 7) && !has_device(scene, 1));
}

TEST_F(SceneInstruments, AGhostIsOfAnotherHandAndWithinItsDevice) {
  const std::string list = tissue + "instruments:\n" + entry("trainee", 1);
  const auto with = [&](const std::string& keys) {
    std::string guided = entry("mentor", 4);
    guided.insert(guided.size() - 2, ", ghost: {" + keys + "}");
    return list + guided;
  };
  EXPECT_FALSE(read(list + entry("mentor", 4)).instruments[1].device.ghost);
  const Scene scene = read(with("of: 1, stiffness: 50, max_force: 0.5"));
  ASSERT_TRUE(scene.instruments[1].device.ghost);
  EXPECT_EQ(scene.instruments[1].device.ghost->of, 0);
  EXPECT_EQ(scene.instruments[1].device.ghost->stiffness, 50);
  EXPECT_EQ(scene.instruments[1].device.ghost->max_force, 0.5);
  EXPECT_NE(describe(scene).find("a spring to trainee: 50 N/m at the device, at most 0.5 N"),
            std::string::npos)
      << describe(scene);
  const auto fault = [&](const std::string& keys, const std::string& key, const std::string& says) {
    expect_fault_in(with(keys), "ghost", "ghost", "instruments[1].ghost." + key, says);
  };
  fault("of: 4, stiffness: 50, max_force: 0.5", "of", "own device");
  fault("of: 9, stiffness: 50, max_force: 0.5", "of", "no device of another");
  fault("of: 1, stiffness: 1e5, max_force: 0.5", "stiffness", "displays stably");
  fault("of: 1, stiffness: 50, max_force: 50", "max_force", "at most the device's");
  fault("of: 1, stiffness: 50", "max_force", "missing");
}

TEST_F(SceneInstruments, OneToFourShareATissue) {
  std::string list = tissue + "instruments:\n";
  for (int n = 1; n <= 4; ++n) {
    list += entry("hand" + std::to_string(n), n);
    const Scene scene = read(list);
    ASSERT_EQ(static_cast<int>(scene.instruments.size()), n);
    EXPECT_EQ(scene.instruments.back().device.id, static_cast<std::uint32_t>(n));
    EXPECT_EQ(scene.instrument_friction, 0);
  }
  list += entry("hand5", 5);
  expect_fault_in(list, "instruments:", "instruments:", "instruments", "5 are too many");
  expect_fault_in(tissue + "instruments: []\n", "instruments:", "instruments:", "instruments",
                  "at least one");
}

// What stands in a list of one is what `instrument` and the keys beside it say.
TEST_F(SceneInstruments, AListOfOneIsTheSceneWithOneInstrument) {
  const std::string own =
      "tip: t, primitives: [{name: t, shape: sphere, radius: 0.1}], coupling: {stiffness: 10, "
      "rotational_stiffness: 2, damping_time: 0.003}";
  const Scene listed = read(tissue + "instruments:\n  - {name: only, " + own +
                            ", removal: {rate: 5, stroke: 0.01}, device: touch, trajectory: move.csv, "
                            "mapping: {position_scale: 2, force_scale: 3}}\n");
  const Scene plain = read(tissue + "instrument: {" + own +
                           "}\nremoval: {rate: 5, stroke: 0.01}\ndevice: touch\ntrajectory: move.csv\n"
                           "mapping: {position_scale: 2, force_scale: 3}\n");
  ASSERT_EQ(listed.instruments.size(), 1u);
  ASSERT_EQ(plain.instruments.size(), 1u);
  EXPECT_EQ(listed.first().name, "only");
  EXPECT_EQ(plain.first().name, "instrument");
  EXPECT_EQ(describe(listed), describe(plain));
  EXPECT_EQ(listed.first().removal.stroke, plain.first().removal.stroke);
  EXPECT_EQ(listed.first().device.id, plain.first().device.id);
}

TEST_F(SceneInstruments, RemovalIsByDegreesUnlessItsLawIsInstant) {
  const auto with = [&](const std::string& law) {
    return read(
        tissue +
        "instrument: {tip: t, primitives: [{name: t, shape: sphere, radius: 0.1}], coupling: {stiffness: "
        "10, rotational_stiffness: 2, damping_time: 0.003}}\nremoval: {rate: 5" +
        law + "}\ndevice: touch\nmapping: {position_scale: 2, force_scale: 3}\n");
  };
  EXPECT_TRUE(with("").first().removal.gradual);
  EXPECT_FALSE(with(", law: instant").first().removal.gradual);
  EXPECT_TRUE(with(", law: gradual").first().removal.gradual);
  EXPECT_THROW(with(", law: slow"), InputError);
}

TEST_F(SceneInstruments, AReplacementIsTheFirstOnesDevice) {
  const Scene scene = read(two_hands, "omni");
  EXPECT_EQ(scene.instruments[0].device_name, "Omni");
  EXPECT_EQ(scene.instruments[0].device.force_scale, 2);
  EXPECT_EQ(scene.instruments[1].device_name, "Falcon");
  // The scene's id stays with the instrument, whatever device it has.
  const std::string with_id = with(two_hands, "    device: touch\n", "    device: touch\n    id: 3\n");
  EXPECT_EQ(read(with_id, "omni").instruments[0].device.id, 3u);
}

TEST_F(SceneInstruments, NamesAndIdsAreDistinct) {
  expect_fault("name: chopper", "name: phaco", "instruments[1].name", "another instrument's name");
  expect_fault("    id: 7", "    id: 0", "instruments[1].id", "0 is another device's id already");
  // Neither says an id, and both files have 0: named at the entry.
  expect_fault("    id: 7\n", "", "instruments[1].id", "give this instrument an id of its own", 34);
}

TEST_F(SceneInstruments, NothingStandsBesideTheListThatBelongsIntoIt) {
  for (const char* key : {"instrument: {tip: ball}", "removal: {rate: 1}", "device: touch",
                          "mapping: {position_scale: 1}", "trajectory: move.csv", "more_devices: []"}) {
    const std::string text = key;
    expect_fault("scene: two hands", "scene: two hands\n" + text, text.substr(0, text.find(':')),
                 "cannot stand beside instruments");
  }
  expect_fault_in(tissue + "instrument_friction: 0.1\ninstrument: {}\n", "instrument_friction: 0.1",
                  "instrument_friction: 0.1", "instrument_friction", "only beside instruments");
  expect_fault_in(tissue, "scene: two hands", "scene: two hands", "instrument", "is missing", 1);
}

TEST_F(SceneInstruments, FaultsOfAnEntryAreNamedThere) {
  expect_fault("    id: 7", "    ids: 7", "instruments[1].ids", "did you mean 'id'?");
  expect_fault("      force_scale: 4", "      force_scale: -4", "instruments[1].mapping.force_scale",
               "above 0");
  expect_fault("      stiffness: 50", "      stiffness: 0", "instruments[1].coupling.stiffness", "above 0");
  expect_fault("tip: hook", "tip: hoof", "instruments[1].tip", "hook");
  expect_fault("radius: 0.05", "radius: 0", "instruments[1].primitives[0].radius", "above 0");
  expect_fault("device: falcon", "device: falcom", "instruments[1].device", "did you mean 'falcon'?");
  expect_fault("move.csv", "none.csv", "instruments[0].trajectory", "no such file");
  expect_fault("    removable: true\n", "", "instruments[0].removal", "no body is removable", 26);
  expect_fault("  - name: chopper\n    tip", "  - tip", "instruments[1].name", "is missing");
  expect_fault("friction: 0.3", "friction: 2.5", "instrument_friction", "at most 2");
  expect_fault("friction: 0.3", "friction: -0.1", "instrument_friction", "at least 0");
}

TEST_F(SceneInstruments, ABladeIsAnEdgeOnTissueThatHasAToughness) {
  const std::string blade =
      "    blade:\n      edge: [[-0.1, 0, 0], [0.1, 0, 0]]\n      direction: [0, 0, -2]\n      samples: 4\n";
  const std::string with_blade = with(
      with(two_hands, "    removable: true\n",
           "    removable: true\n    toughness: 120\n    cutting_viscosity: 30\n    max_new_nodes: 500\n"),
      "    device: falcon\n", blade + "    device: falcon\n");
  const Scene scene = read(with_blade);
  EXPECT_EQ(scene.bodies[0].toughness, 120);
  EXPECT_EQ(scene.bodies[0].cutting_viscosity, 30);
  EXPECT_TRUE(scene.instruments[0].shape.blade.sample.empty());
  const Blade& read_back = scene.instruments[1].shape.blade;
  ASSERT_EQ(read_back.sample.size(), 4u);
  EXPECT_EQ(read_back.direction, -Vec3::UnitZ());
  EXPECT_NEAR(read_back.sample[0].place.x(), -0.075, 1e-15);
  EXPECT_NEAR(read_back.sample[0].width, 0.05, 1e-15);
  EXPECT_NE(describe(scene).find("blade      200.00 mm wide, 4 samples"), std::string::npos);
  EXPECT_NE(describe(scene).find("toughness 120 J/m2"), std::string::npos);

  // The line of `place` in the changed scene.
  const auto expect = [&](const std::string& old, const std::string& replacement, const std::string& place,
                          const std::string& key, const std::string& words) {
    const std::string text = with(with_blade, old, replacement);
    const auto end = text.begin() + static_cast<std::ptrdiff_t>(text.find(place));
    expect_fault_in(with_blade, old, replacement, key, words,
                    1 + static_cast<int>(std::count(text.begin(), end, '\n')));
  };
  expect("    max_new_nodes: 500\n", "", "  - name:", "bodies[0].max_new_nodes", "missing");
  expect("    toughness: 120\n", "", "cutting_viscosity", "bodies[0].cutting_viscosity", "needs a toughness");
  expect("viscosity: 30", "viscosity: -1", "cutting_viscosity", "bodies[0].cutting_viscosity", "at least 0");
  expect("toughness: 120", "toughness: 0", "toughness", "bodies[0].toughness", "above 0");
  expect("    toughness: 120\n    cutting_viscosity: 30\n    max_new_nodes: 500\n", "",
         "blade:", "instruments[1].blade", "no body can be cut");
  expect("samples: 4", "samples: 33", "samples", "instruments[1].blade.samples", "32");
  expect("direction: [0, 0, -2]", "direction: [0, 0, 0]", "direction", "instruments[1].blade.direction",
         "is zero");
  expect("direction: [0, 0, -2]", "direction: [1, 0, 0]", "edge:", "instruments[1].blade.edge",
         "along the edge");
  expect("[[-0.1, 0, 0], [0.1, 0, 0]]", "[[-0.1, 0, 0]]", "edge:", "instruments[1].blade.edge", "two points");
  expect("      edge:", "      edges:", "edges:", "instruments[1].blade.edges", "did you mean 'edge'?");
}

TEST_F(SceneInstruments, DevicesWithTissueOfTheirOwnNeedOneInstrument) {
  Scene scene = read(two_hands);
  try {
    add_device(scene, "touch");
    ADD_FAILURE() << "was accepted";
  } catch (const InputError& e) {
    EXPECT_EQ(e.file(), folder_ / "scene.yaml");
    EXPECT_EQ(e.key(), "instruments");
  }
  Scene one = read(tissue + "instruments:\n" + entry("only", 0));
  add_device(one, "touch");
  ASSERT_EQ(one.more_devices.size(), 1u);
  EXPECT_EQ(one.more_devices[0].id, 1u);
}

TEST_F(SceneInstruments, AllAreDescribed) {
  const Scene scene = read(two_hands);
  const std::string text = describe(scene);
  for (const char* words :
       {"phaco: 1 primitives", "chopper: 1 primitives", "Touch, id 0: ", "Falcon, id 7: ", "friction 0.3"})
    EXPECT_NE(text.find(words), std::string::npos) << words << '\n' << text;
  const nlohmann::ordered_json json = instruments_to_json(scene);
  ASSERT_EQ(json.size(), 2u);
  EXPECT_EQ(json[0].at("name"), "phaco");
  EXPECT_EQ(json[0].at("removes"), true);
  EXPECT_EQ(json[1].at("device"), "Falcon");
  EXPECT_EQ(json[1].at("id"), 7);
  EXPECT_EQ(json[1].at("felt_stiffness"), 50);
}

// A port with today's keys, or with its pump's in a map, which may have a flow.
TEST_F(SceneInstruments, APortHasAPumpAndALumen) {
  const auto with_port = [&](const std::string& port, const std::string& aspiration) {
    std::string e = entry("phaco", 1);
    e.insert(e.size() - 2, ", port: {radius: 0.01, reach: 0.01, " + port +
                               "}, removal: {rate: 1, aspiration: {" + aspiration + "}}");
    return tissue + "instruments:\n" + e;
  };
  const std::string count = "reach: 0.01, max_elements: 9";
  const Scene plain = read(with_port("vacuum: 1000, rise_time: 0.5", count));
  EXPECT_EQ(plain.first().shape.port.vacuum, 1000);
  EXPECT_EQ(plain.first().shape.port.flow, 0);
  EXPECT_EQ(plain.first().shape.port.lumen, 0);
  const std::string pump = "pump: {vacuum: 2000, rise_time: 0.4, flow: 5.0e-7}";
  const Scene scene = read(with_port(pump + ", lumen: 0.02", "reach: 0.03"));
  const Port& port = scene.first().shape.port;
  EXPECT_EQ(port.vacuum, 2000);
  EXPECT_EQ(port.rise_time, 0.4);
  EXPECT_EQ(port.flow, 5e-7);
  EXPECT_EQ(port.lumen, 0.02);
  EXPECT_EQ(scene.first().removal.aspiration_reach, 0.03);
  EXPECT_NE(describe(scene).find("30 ml/min, tubing 100 mm3/kPa"), std::string::npos) << describe(scene);
  EXPECT_NE(describe(scene).find("a lumen of radius 20.00 mm"), std::string::npos) << describe(scene);
  const auto fault = [&](const std::string& text, const std::string& key, const std::string& says) {
    expect_fault_in(text, "phaco", "phaco", "instruments[0]." + key, says);
  };
  fault(with_port(pump + ", vacuum: 1000", count), "port.vacuum", "stands in pump already");
  fault(with_port("pump: {vacuum: 2000, flow: 5.0e-7}", count), "port.pump.rise_time", "missing");
  fault(with_port("pump: {vacuum: 2000, rise_time: 0, flow: 5.0e-7}", count), "port.pump.rise_time",
        "builds");
  fault(with_port("pump: {vacuum: 2000, rise_time: 1, flow: 30}", count), "port.pump.flow", "30 ml/min");
  fault(with_port(pump + ", lumen: 0", "reach: 0.03"), "port.lumen", "metres");
  fault(with_port(pump + ", lumen: 0.02", count), "removal.aspiration.max_elements", "port.lumen");
  fault(with_port(pump, "reach: 0.03"), "removal.aspiration.max_elements", "missing");
}

// The ring that a shaft passes through; its axis is out of the body, from the device's origin unless said.
TEST_F(SceneInstruments, AnIncisionIsARing) {
  const auto with_ring = [&](const std::string& ring, const std::string& mapping) {
    std::string e = entry("phaco", 1);
    e = with(e, "force_scale: 1", "force_scale: 1, origin: [0, 0, 1]" + mapping);
    e.insert(e.size() - 2, ", incision: {" + ring + "}");
    return tissue + "instruments:\n" + e;
  };
  const std::string at = "at: [0, 0, 3], ", rest = "slack: 0.001, stiffness: 500";
  const Scene scene = read(with_ring(at + rest + ", friction: 0.2", ""));
  const Incision& ring = scene.first().shape.incision;
  EXPECT_EQ(ring.at, Vec3(0, 0, 3));
  EXPECT_EQ(ring.axis, Vec3::UnitZ());
  EXPECT_EQ(ring.slack, 0.001);
  EXPECT_EQ(ring.stiffness, 500);
  EXPECT_EQ(ring.friction, 0.2);
  EXPECT_NE(describe(scene).find("slack 1000 um, 500 N/m, friction 0.2"), std::string::npos)
      << describe(scene);
  EXPECT_EQ(read(with_ring(at + "axis: [0, 2, 0], " + rest, "")).first().shape.incision.axis, Vec3::UnitY());
  EXPECT_EQ(read(tissue + "instruments:\n" + entry("phaco", 1)).first().shape.incision.stiffness, 0);
  const std::string pivot = ", pivot: {point: [0, 0.0005, 3]}";
  EXPECT_TRUE(read(with_ring(at + rest, pivot)).first().device.pivot);
  const auto fault = [&](const std::string& text, const std::string& key, const std::string& says) {
    expect_fault_in(text, "phaco", "phaco", "instruments[0].incision." + key, says);
  };
  fault(with_ring("at: [0, 0, 1], " + rest, ""), "at", "mapping.origin");
  fault(with_ring(at + "axis: [0, 0, 0], " + rest, ""), "axis", "is zero");
  fault(with_ring(at + "slack: 0, stiffness: 500", ""), "slack", "metres");
  fault(with_ring(at + "slack: 0.001", ""), "stiffness", "missing");
  fault(with_ring(at + "slack: 0.001, stiffness: 0", ""), "stiffness", "newtons per metre");
  fault(with_ring(at + rest + ", friction: 3", ""), "friction", "Coulomb");
  fault(with_ring(at + "slack: 0.0001, stiffness: 500", pivot), "at", "farther than slack");
  fault(with_ring(at + rest + ", play: 1", ""), "play", "unknown");
}

}  // namespace
}  // namespace hapticd
