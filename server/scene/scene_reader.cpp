#include "server/scene/scene_reader.h"

#include <tuple>

#include "server/files/yaml_keys.h"
#include "server/scene/scene_bodies.h"
#include "server/scene/scene_instruments.h"

namespace hapticd {
namespace {

constexpr std::size_t most_viscous_bodies = std::tuple_size_v<decltype(ViscousOptions::relaxation)>;

constexpr NumberRange rate{1, 500, false, false, "simulation steps per second; 50 is usual"};
constexpr NumberRange accuracy{0, 1, true, false,
                               "RMS force error over the peak force; 0.02 is two per cent"};
constexpr NumberRange alarm_distance{0, 0.1, true, false, "metres; more than the tip moves in one step"};
constexpr NumberRange sample_spacing{0, 0.1, true, false, "metres; about a third of the tip's radius"};

// As the key names them. No `dense`: an oracle, impossible beyond a thousand nodes.
constexpr ComplianceMethod compliance_methods[] = {ComplianceMethod::exact, ComplianceMethod::zone,
                                                   ComplianceMethod::lazy, ComplianceMethod::updown};

void read_simulation(const YamlMap& yaml, Scene& scene) {
  yaml.only({"rate", "compliance", "contact", "alarm_distance", "sample_spacing"});
  scene.rate = yaml.number("rate", rate, scene.rate);
  scene.pinned_compliance = yaml.has("compliance");
  scene.pinned_contact = yaml.has("contact");
  if (yaml.has("compliance"))
    scene.compliance = compliance_methods[yaml.choice("compliance", {"exact", "zone", "lazy", "updown"})];
  if (yaml.has("contact"))
    scene.contact = yaml.choice("contact", {"renewed", "frozen"}) == 0 ? Renewal::renewed : Renewal::frozen;
  scene.alarm_distance = yaml.number("alarm_distance", alarm_distance);
  scene.sample_spacing = yaml.number("sample_spacing", sample_spacing);
}

// `model: auto`, or a map of what is not to be chosen, for all bodies alike.
void read_model(const YamlMap& yaml, Scene& scene) {
  scene.plans = true;
  if (!yaml.is_map("model")) {
    yaml.choice("model", {"auto"});
    return;
  }
  const YamlMap pins = yaml.map("model");
  pins.only({"elements", "motion", "friction"});
  scene.pinned_friction = pins.has("friction");
  scene.friction = pins.flag("friction", true);
  const bool linear = pins.has("elements") && pins.choice("elements", {"corotational", "linear"}) == 1;
  const bool still = pins.has("motion") && pins.choice("motion", {"dynamic", "static"}) == 1;
  for (SceneBody& body : scene.bodies) {
    if (pins.has("elements") && !body.pinned_elements) body.corotational = !linear;
    // Static only where that can be: what can be cut stays dynamic.
    if (pins.has("motion") && !body.pinned_motion) body.dynamic = !(still && may_be_static(body));
    body.pinned_elements |= pins.has("elements");
    body.pinned_motion |= pins.has("motion");
  }
}

LoopMode read_haptic_mode(const YamlMap& yaml) {
  yaml.only({"mode"});
  return yaml.choice("mode", {"tick", "event"}) == 0 ? LoopMode::tick : LoopMode::event;
}

}  // namespace

Scene read_scene(const std::filesystem::path& file, const std::string& device) {
  const YamlMap yaml = YamlMap::open(file);
  yaml.only({"scene", "model", "accuracy", "simulation", "gravity", "bodies", "contacts", "instrument",
             "instruments", "instrument_friction", "removal", "haptic", "device", "mapping", "more_devices",
             "trajectory", "ros2", "logging"});
  Scene scene;
  scene.file = file;
  scene.name = yaml.text("scene");
  read_simulation(yaml.map("simulation"), scene);
  scene.gravity = yaml.vec3("gravity", Vec3::Zero());

  for (const YamlMap& entry : yaml.maps("bodies")) {
    SceneBody body = read_body(entry);
    for (const SceneBody& other : scene.bodies)
      if (other.name == body.name)
        throw entry.error("name", "'" + body.name + "' is another body's name already");
    if (scene.bodies.size() >= most_viscous_bodies && body.kind == BodyKind::deformable &&
        body.material.rayleigh_stiffness > 0)
      throw entry.error("material",
                        "the haptic loop knows the viscosity of the first " +
                            std::to_string(most_viscous_bodies) +
                            " bodies only: name this body earlier, or give it no rayleigh stiffness");
    scene.bodies.push_back(std::move(body));
  }
  if (yaml.has("contacts"))
    for (const YamlMap& entry : yaml.maps("contacts")) {
      const ContactPair pair = read_contact(entry, scene.bodies);
      for (const ContactPair& other : scene.contacts)
        if (other.points == pair.points && other.faces == pair.faces)
          throw entry.error("between", "this pair stands there already");
      scene.contacts.push_back(pair);
    }

  if (yaml.has("model")) read_model(yaml, scene);
  scene.accuracy = yaml.number("accuracy", accuracy, scene.accuracy);

  read_instruments(yaml, device, scene);
  if (yaml.has("haptic")) scene.haptic_mode = read_haptic_mode(yaml.map("haptic"));
  scene.ros2 = yaml.flag("ros2", false);
  if (yaml.has("logging")) {
    const YamlMap logging = yaml.map("logging");
    logging.only({"level"});
    logging.choice("level", {"debug", "info", "warning", "error"});
    scene.log_level = logging.text("level");
  }
  return scene;
}

}  // namespace hapticd
