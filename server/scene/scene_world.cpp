#include "server/scene/scene_world.h"

#include <algorithm>

namespace hapticd {

namespace {

// When a published problem is used, in steps after its pose was latched: from 0.4 on, for one step.
constexpr double middle_of_use = 0.9;
// Steps between two samples of a compliance's error: each costs two solves and an assembly, and what a
// reference factor is off by changes slowly.
constexpr int error_sample_every = 25;
// Rows renewed at 1 kHz need only reach as far as surface and instrument move in a few ticks.
constexpr double haptic_margin = 0.15;  // in alarm distances
// A hyperstatic patch (contact/README.md) may use them all; its residual is then below 1e-4 already.
constexpr int haptic_max_sweeps = 50;
// Forces turned by less are as good as renewed: 0.2 %, and a device's quantum is not much less.
constexpr double haptic_turned = 2e-3;  // [rad]
// Crumbs are flung about faster than two linearisations follow.
constexpr double haptic_too_deep = 0.025;  // alarm distances
// Where tissue becomes less, a new problem knows a tick late which samples touch: a step of a tenth of the
// peak. After each problem it would cost a wall half of its stiffness.
constexpr double haptic_thinning_time = 2e-3;  // [s]

bool deforms(const SceneBody& b) { return b.kind == BodyKind::deformable && b.simulated; }

}  // namespace

WorldSettings world_settings(const Scene& scene) {
  WorldSettings settings;
  settings.h = 1.0 / scene.rate;
  settings.alarm_distance = scene.alarm_distance;
  settings.sample_spacing = scene.sample_spacing;
  settings.contact = scene.contact;
  settings.gravity = scene.gravity;
  settings.compliance = scene.compliance;
  settings.compliance_options.synchronous_reference = false;  // a thread makes them (reference_maker.h)
  settings.compliance_options.quantised_reference = true;
  settings.compliance_options.sample_every = error_sample_every;
  settings.lead = middle_of_use / scene.rate;
  for (std::size_t i = 0; i < scene.instruments.size(); ++i) {
    settings.coupling[static_cast<int>(i)] = scene.instruments[i].coupling;
    settings.removal[static_cast<int>(i)] = scene.instruments[i].removal;
  }
  settings.instrument_friction = scene.friction ? scene.instrument_friction : 0;
  for (ContactPair pair : scene.contacts) {
    // Two obstacles have nothing to say to each other.
    if (!deforms(scene.bodies[pair.points]) && !deforms(scene.bodies[pair.faces])) continue;
    if (!scene.friction) pair.friction = 0;
    settings.body_contact.pairs.push_back(pair);
  }
  return settings;
}

// A split edge adds a node and as many tetrahedra as it has around it, about five.
constexpr int tets_per_new_node = 6;

std::unique_ptr<World> make_world(const Scene& scene, const WorldSettings& settings) {
  std::vector<BodySettings> bodies;
  for (const SceneBody& b : scene.bodies)
    bodies.push_back({b.name,
                      deforms(b),
                      b.mesh,
                      b.material,
                      b.fixed_nodes,
                      scene.friction ? b.friction : 0,
                      b.removable && deforms(b),
                      b.corotational,
                      b.dynamic,
                      {b.max_new_nodes, tets_per_new_node * b.max_new_nodes},
                      b.toughness,
                      b.tearing,
                      b.cutting_viscosity,
                      b.regions,
                      b.springs,
                      b.near,
                      deforms(b) ? b.start : nullptr});
  auto world = std::make_unique<World>(std::move(bodies), shapes_of(scene), settings);
  world->make_regions([&](int made) { return made >= scene.regions; });
  return world;
}

std::unique_ptr<World> make_world(const Scene& scene) { return make_world(scene, world_settings(scene)); }

HapticOptions haptic_options(const Scene& scene) {
  HapticOptions options;
  options.contact.linearisations = 2;
  options.contact.turned = haptic_turned;
  options.contact.too_deep = haptic_too_deep * scene.alarm_distance;
  options.thinning_time = haptic_thinning_time;
  // Rows frozen for a step must reach as far as the instrument moves in it: the alarm distance.
  options.contact.margin = scene.contact == Renewal::frozen ? 0 : haptic_margin * scene.alarm_distance;
  options.contact.coulomb.max_sweeps = haptic_max_sweeps;
  options.viscous.step = 1 / scene.rate;
  for (std::size_t b = 0; b < std::min(scene.bodies.size(), options.viscous.relaxation.size()); ++b)
    options.viscous.relaxation[b] = scene.bodies[b].material.rayleigh_stiffness;
  // The patch is one, so the device that needs the longest has it.
  for (const SceneInstrument& i : scene.instruments)
    options.viscous.lag = std::max(
        options.viscous.lag,
        lag_for(i.device.quantum, i.coupling.stiffness * i.device.position_scale * i.device.force_scale,
                *std::max_element(options.viscous.relaxation.begin(), options.viscous.relaxation.end()),
                1e-9 * static_cast<double>(options.watchdog.period_ns)));
  return options;
}

std::vector<Instrument> shapes_of(const Scene& scene) {
  std::vector<Instrument> shapes;
  for (const SceneInstrument& i : scene.instruments) shapes.push_back(i.shape);
  return shapes;
}

std::vector<DeviceSettings> devices_of(const Scene& scene) {
  std::vector<DeviceSettings> devices;
  for (const SceneInstrument& i : scene.instruments) devices.push_back(i.device);
  return devices;
}

std::int64_t memory_of(const Scene& scene) noexcept {
  std::int64_t nodes = 0;
  for (const SceneBody& body : scene.bodies) nodes += static_cast<std::int64_t>(body.mesh.nodes.size());
  return 32'000 * nodes;
}

}  // namespace hapticd
