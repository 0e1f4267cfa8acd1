// A scene as it stands in its YAML file, checked: what exists, of what, and how it is run.
//
// Units in the file are SI, as here. Meshes are already read; the reader (scene_reader.h) refuses
// anything inconsistent with file, line and key.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "haptic/device.h"
#include "haptic/loop.h"
#include "physics/compliance/compliance.h"
#include "physics/compliance/condense_far.h"
#include "physics/contact/condensed_problem.h"
#include "physics/contact/instrument.h"
#include "physics/cutting/tearing.h"
#include "physics/simulation/body_contact/contact_candidates.h"
#include "physics/simulation/step/removal.h"
#include "physics/tissue/material.h"
#include "physics/tissue/mesh.h"
#include "physics/tissue/tissue_parts.h"

namespace hapticd {

struct BodyStart;

enum class BodyKind { deformable, rigid };  // rigid: a fixed obstacle

struct SceneBody {
  std::string name;
  BodyKind kind = BodyKind::deformable;
  std::filesystem::path mesh_file;
  TetMesh mesh;
  Material material;                            // deformable only
  std::vector<int> fixed_nodes;                 // deformable only; empty: it floats, or springs hold it
  std::vector<TissueRegion> regions = {};       // deformable only; what differs from the material
  std::vector<NodeSpring> springs = {};         // deformable only; per node, or empty
  std::optional<NearRegion> near = {};          // deformable only; what is farther is condensed
  double friction = 0;                          // μ against the instrument
  bool removable = false;                       // the tip may destroy it
  double toughness = 0;                         // J [J/m²]: a blade's edge cuts it; 0: none does
  double cutting_viscosity = 0;                 // c: … and more by its speed [N·s/m²]
  int max_new_nodes = 0;                        // that cuts may add
  TearSettings tearing = {};                    // off unless its toughness is positive
  bool corotational = true;                     // deformable only; false: linear
  bool dynamic = true;                          // deformable only; false: neither inertia nor damping
  bool simulated = true;                        // deformable only; false: stands where it is, an obstacle
  std::shared_ptr<const BodyStart> start = {};  // deformable only; null: at rest (body.h)
  // Said by the scene, so that the plan leaves it.
  bool pinned_elements = false, pinned_motion = false, pinned_simulated = false;
};

// What one hand holds: an instrument, the device that moves it, and what it does to tissue.
struct SceneInstrument {
  std::string name;  // "instrument" where the scene does not list its instruments
  Instrument shape;
  VirtualCoupling coupling;
  RemovalSettings removal;
  DeviceSettings device;  // its limits, and its map into the scene
  std::string device_name;
  double device_stiffness = 0;  // largest the device displays stably [N/m]
  std::filesystem::path device_file;
  std::optional<std::filesystem::path> trajectory;  // the shipped one, in this device's frame
};

struct Scene {
  std::string name;
  std::filesystem::path file;
  double rate = 50;        // simulation [Hz]
  int regions = 0;         // near regions condensed before the first step; of a run that was recorded
  bool plans = false;      // model: auto: what is not pinned is chosen at the start (plan.h)
  double accuracy = 0.02;  // RMS force error that a plan may have, of the peak force
  bool friction = true;    // false: every μ counts as 0
  bool pinned_compliance = false, pinned_contact = false, pinned_friction = false;
  ComplianceMethod compliance = ComplianceMethod::exact;
  Renewal contact = Renewal::renewed;
  double alarm_distance = 0;  // [m]
  double sample_spacing = 0;  // of material sample points [m]
  Vec3 gravity = Vec3::Zero();
  std::vector<SceneBody> bodies;
  std::vector<ContactPair> contacts;  // bodies that touch one another, by index
  // In one tissue: one to four, in the order of the file; names and device ids are distinct.
  std::vector<SceneInstrument> instruments = std::vector<SceneInstrument>(1);
  double instrument_friction = 0;  // μ between instruments
  LoopMode haptic_mode = LoopMode::tick;
  // Each with a tissue of its own (world_session.h); only where the scene has one instrument.
  std::vector<DeviceSettings> more_devices;
  std::string log_level = "info";  // what is below is not said
  bool ros2 = false;               // mirror topics for ROS 2

  SceneInstrument& first() { return instruments.front(); }
  const SceneInstrument& first() const { return instruments.front(); }
};

}  // namespace hapticd
