// The cube with two balls on sticks in it, 12 mm apart: `left`, whose device is 3, and `right`, whose is 5.
#pragma once

#include <string>

#include "tests/tools/run_command.h"

namespace hapticd {

// keys: more of the left hand, "    key: value\n".
inline std::string two_on_a_cube(const ScratchDirectory& scratch, const std::string& keys = "") {
  const auto hand = [](const char* name, int id, const char* x) {
    return std::string("  - name: ") + name +
           "\n    tip: tip\n    primitives:\n"
           "      - {name: tip, shape: sphere, radius: 3.0e-3}\n"
           "      - {name: stick, shape: cylinder, radius: 2.0e-3, from: [0, 0, 0], to: [0, 0, 60.0e-3]}\n"
           "    coupling: {stiffness: 400, rotational_stiffness: 0.04, damping_time: 2.0e-3}\n"
           "    device: touch\n    id: " +
           std::to_string(id) + "\n    mapping: {position_scale: 1, force_scale: 1, origin: [" + x +
           ", 0, 0]}\n";
  };
  return scratch.file("two.yaml",
                      "scene: two on a cube\n"
                      "simulation: {rate: 50, alarm_distance: 5.0e-3, sample_spacing: 1.0e-3}\n"
                      "bodies:\n  - name: cube\n    kind: deformable\n    mesh: " SOURCE_DIR
                      "/config/scenes/cube/cube.msh\n    fixed: bottom\n"
                      "    material: {young: 5.0e3, poisson: 0.45, density: 1000, rayleigh: {mass: 2.0, "
                      "stiffness: 2.0e-3}}\n"
                      "instruments:\n" +
                          hand("left", 3, "-6.0e-3") + keys + hand("right", 5, "6.0e-3"));
}

// 1.5 mm down onto the cube and up, in 1.2 s from `begin` on [s]. Device frame.
inline std::string press_from(const ScratchDirectory& scratch, const std::string& name, double begin) {
  std::string text = "t,px,py,pz\n";
  for (const auto& [t, z] : {std::pair(0.0, 0.0245), {0.3, 0.0215}, {0.9, 0.0215}, {1.2, 0.0245}})
    text += std::to_string(begin + t) + ",0,0," + std::to_string(z) + "\n";
  return scratch.file(name, text);
}

}  // namespace hapticd
