// The configurations that `haptic chart force` compares: one entry of a YAML list each.
//
//   default: exact                        the label that the others are judged against
//   finest: {lens: lens_5k.msh}           meshes that are the truth in space, by body (may be absent)
//   windows:                              parts of the scene's own trajectories; of several instruments a
//   must
//     - {name: press, from: 4.6, to: 7.6}            [s]
//     - {name: sculpt, from: 8, to: 10, removals: true}
//     - {name: crack, from: 20, to: 21, history: true}    on what the operation left until then
//   configurations:
//     - {label: exact, quick: true}       every key but the label may be absent: the scene's own then
//     - {label: at 100 Hz, rate: 100}
//
// Keys: label, quick (also in a quick chart), rate [Hz], compliance, warping, contact, corotational, friction
// (false: none anywhere), rendering, newest_pose, fresh_free_motion, lead [steps], viscous, linearisations,
// tolerance, sweeps, limits (true: those of the devices), blend [s], reference_after [s], interim (false:
// removals are felt with the step's own problem), interim_after [s], refresh (false: none after removals),
// meshes (body: file beside the table). Units: SI. Errors: InputError with file, line and key.
#pragma once

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "tools/chart/force/force_motion.h"
#include "tools/offline/offline_run.h"

namespace hapticd {

using MeshFiles = std::map<std::string, std::filesystem::path>;  // by body

struct ForceConfiguration {
  std::string label;
  bool quick = false;
  OfflineOptions options;
  std::optional<double> rate;
  std::optional<ComplianceMethod> compliance;
  std::optional<Renewal> contact;
  bool corotational = true;
  bool friction = true;
  MeshFiles meshes;
  nlohmann::ordered_json words;  // the keys as they stand in the table, for the figures
};

struct ForceTable {
  std::string default_label;
  MeshFiles finest;
  std::vector<ForceWindow> windows;
  std::vector<ForceConfiguration> configurations;
};

ForceTable read_force_table(const std::filesystem::path& file);

// The scene as this configuration runs it.
Scene configured(const Scene& scene, const ForceConfiguration& configuration);
Scene with_meshes(const Scene& scene, const MeshFiles& meshes);

}  // namespace hapticd
