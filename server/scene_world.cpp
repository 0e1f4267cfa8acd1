#include "server/scene_world.h"

namespace hapticd {

namespace {

// Steps between two samples of a compliance's error: each costs two solves and an assembly, and what a base
// is off by changes slowly.
constexpr int error_sample_every = 25;

}  // namespace

std::unique_ptr<World> make_world(const Scene& scene) {
  std::vector<BodySettings> bodies;
  for (const SceneBody& b : scene.bodies)
    bodies.push_back(
        {b.name, b.kind == BodyKind::deformable, b.mesh, b.material, b.fixed_nodes, b.friction, b.removable});
  WorldSettings settings;
  settings.h = 1.0 / scene.rate;
  settings.alarm_distance = scene.alarm_distance;
  settings.sample_spacing = scene.sample_spacing;
  settings.contact = scene.contact;
  settings.gravity = scene.gravity;
  settings.compliance = scene.compliance;
  settings.compliance_options.base_on_the_spot = false;  // a thread makes them (base_maker.h)
  settings.compliance_options.rounded_base = true;
  settings.compliance_options.sample_every = error_sample_every;
  settings.coupling = scene.coupling;
  settings.removal = scene.removal;
  settings.body_contact.pairs = scene.contacts;
  return std::make_unique<World>(std::move(bodies), scene.instrument, settings);
}

}  // namespace hapticd
