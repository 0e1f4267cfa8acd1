// A stranger's mesh as a running scene: every default chosen from the mesh's size, and said why.
//
//   tip radius r = clamp(2 · mean surface edge, D/30, D/8)    elements no larger than half the tip's radius
//   alarm distance 1.6 r,  sample spacing r/3                 D: the bounding box's diagonal
//   coupling 10 · 2 E/(1−ν²) √(r · r/2)                       ten times Hertz's stiffness, r/2 deep
//   position scale: 60 mm of the hand are 0.3 D               force scale: the coupling feels like 400 N/m
//
// The tissue is that of a soft organ: E 3 kPa, ν 0.45, 1000 kg/m³. It is held by the mesh's group whose name
// says so, else by its lowest tenth, along z.
//
// With a blade in place of the tip that removes: an upright edge of 2.5 r that cuts along x, a sample for
// each third of a mean edge l, the sheet two edges behind it; J = E l; room for new nodes 4 A/l², A = D²/4 of
// cuts. Units: SI; the mesh in metres. Errors: std::runtime_error when a file cannot be written.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "physics/tissue/mesh.h"
#include "physics/tissue/mesh_quality.h"

namespace hapticd {

struct SceneDefaults {
  std::string fixed;               // the group that holds it
  bool fixed_is_new = false;       // made here: the lowest tenth
  double tip_radius = 0;           // [m]
  double alarm_distance = 0;       // [m]
  double sample_spacing = 0;       // [m]
  double coupling = 0;             // [N/m]
  double rotational_coupling = 0;  // [N·m/rad]
  double position_scale = 0;       // scene metres per device metre
  double force_scale = 0;          // device newtons per scene newton
  Vec3 origin = Vec3::Zero();      // a radius above the top
  double blade = 0;                // length of its edge [m]; 0: a round tip that removes
  double mean_edge = 0;            // of the tetrahedra [m]
  double toughness = 0;            // [J/m²]
  int max_new_nodes = 0;
  std::vector<std::string> reasons;  // one line each
};

SceneDefaults scene_defaults(const TetMesh& mesh, const MeshQuality& quality, bool blade);

// Gives the mesh the group `defaults.fixed` where it is new.
void add_fixed_group(TetMesh& mesh, const SceneDefaults& defaults);

// The scene's text; `mesh_file` as it shall stand in it.
std::string scene_text(const SceneDefaults& defaults, const std::string& name, const std::string& mesh_file);

}  // namespace hapticd
