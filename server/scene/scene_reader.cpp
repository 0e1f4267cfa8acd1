#include "server/scene/scene_reader.h"

#include <algorithm>
#include <tuple>

#include "server/files/paths.h"
#include "server/record/trajectory_reader.h"
#include "server/scene/device_reader.h"
#include "server/scene/scene_bodies.h"

namespace hapticd {
namespace {

constexpr std::size_t most_viscous_bodies = std::tuple_size_v<decltype(ViscousOptions::relaxation)>;

constexpr NumberRange rate{1, 500, false, false, "simulation steps per second; 50 is usual"};
constexpr NumberRange accuracy{0, 1, true, false,
                               "RMS force error over the peak force; 0.02 is two per cent"};
constexpr NumberRange alarm_distance{0, 0.1, true, false, "metres; more than the tip moves in one step"};
constexpr NumberRange sample_spacing{0, 0.1, true, false, "metres; about a third of the tip's radius"};
constexpr NumberRange stiffness{0, 1e6, true, false, "newtons per metre; about ten times the contact's own"};
constexpr NumberRange rotational_stiffness{0, 1e4, true, false, "newton metres per radian"};
constexpr NumberRange damping_time{0, 1, false, false, "seconds; about 0.002"};
constexpr NumberRange removal_rate{0, 1e5, false, false, "tetrahedra per second; 0: none"};
constexpr NumberRange reach{0, 0.1, false, false, "metres"};
constexpr NumberRange position_scale{0, 1e3, true, false, "scene metres per device metre"};
constexpr NumberRange force_scale{0, 1e6, true, false, "device newtons per scene newton"};

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

VirtualCoupling read_coupling(const YamlMap& yaml) {
  yaml.only({"stiffness", "rotational_stiffness", "damping_time"});
  VirtualCoupling coupling;
  coupling.stiffness = yaml.number("stiffness", stiffness);
  coupling.rotational_stiffness = yaml.number("rotational_stiffness", rotational_stiffness);
  coupling.damping_time = yaml.number("damping_time", damping_time);
  return coupling;
}

RemovalSettings read_removal(const YamlMap& yaml) {
  yaml.only({"rate", "stroke", "aspiration"});
  RemovalSettings removal;
  removal.rate = yaml.number("rate", removal_rate);
  removal.stroke = yaml.number("stroke", reach, 0);
  if (yaml.has("aspiration")) {
    const YamlMap aspiration = yaml.map("aspiration");
    aspiration.only({"reach", "max_elements"});
    removal.aspiration_reach = aspiration.number("reach", reach);
    removal.aspiration_max_tets = aspiration.whole("max_elements", 0, 1'000'000);
  }
  return removal;
}

void read_device_of(const YamlMap& yaml, const std::string& replacement, Scene& scene) {
  const std::string name = replacement.empty() ? yaml.text("device") : replacement;
  scene.device_file =
      device_path(name, replacement.empty() ? yaml.folder() : std::filesystem::current_path());
  if (!std::filesystem::is_regular_file(scene.device_file)) {
    const std::string what =
        "no such file: " + scene.device_file.string() + " (a name from config/devices, or a path)";
    throw replacement.empty() ? yaml.error("device", what) : InputError(scene.device_file, 0, "device", what);
  }
  const DeviceFile device = read_device(scene.device_file);
  scene.device = device.limits;
  scene.device_name = device.name;
  scene.device_stiffness = device.max_stiffness;
}

void read_mapping(const YamlMap& yaml, DeviceSettings& device) {
  yaml.only({"position_scale", "force_scale", "origin", "frame", "tool"});
  device.position_scale = yaml.number("position_scale", position_scale);
  device.force_scale = yaml.number("force_scale", force_scale);
  device.origin = yaml.vec3("origin", Vec3::Zero());
  device.frame = yaml.quaternion("frame");
  device.tool = yaml.quaternion("tool");
}

// A device's limits by name or path, with an id of its own.
DeviceSettings read_further_device(const YamlMap& yaml, const Scene& scene) {
  yaml.only({"device", "id", "mapping"});
  const std::filesystem::path file = device_path(yaml.text("device"), yaml.folder());
  if (!std::filesystem::is_regular_file(file))
    throw yaml.error("device", "no such file: " + file.string() + " (a name from config/devices, or a path)");
  DeviceSettings device = read_device(file).limits;
  device.id = static_cast<std::uint32_t>(yaml.whole("id", 0, 1'000'000));
  if (has_device(scene, device.id))
    throw yaml.error("id", std::to_string(device.id) + " is another device's id already");
  read_mapping(yaml.map("mapping"), device);
  return device;
}

}  // namespace

bool has_device(const Scene& scene, std::uint32_t id) {
  return scene.device.id == id || std::any_of(scene.more_devices.begin(), scene.more_devices.end(),
                                              [id](const DeviceSettings& d) { return d.id == id; });
}

void add_device(Scene& scene, const std::string& name) {
  const std::filesystem::path file = device_path(name, std::filesystem::current_path());
  if (!std::filesystem::is_regular_file(file))
    throw InputError(file, 0, "device", "no such file (a name from config/devices, or a path)");
  const DeviceSettings limits = read_device(file).limits;
  DeviceSettings device = scene.device;  // its map into the scene
  device.max_force = limits.max_force;
  device.max_torque = limits.max_torque;
  device.max_force_rate = limits.max_force_rate;
  device.max_speed = limits.max_speed;
  device.workspace_radius = limits.workspace_radius;
  device.damping = limits.damping;
  device.id = limits.id;
  while (has_device(scene, device.id)) ++device.id;
  scene.more_devices.push_back(device);
}

Scene read_scene(const std::filesystem::path& file, const std::string& device) {
  const YamlMap yaml = YamlMap::open(file);
  yaml.only({"scene", "model", "accuracy", "simulation", "gravity", "bodies", "contacts", "instrument",
             "removal", "haptic", "device", "mapping", "more_devices", "trajectory", "ros2", "logging"});
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

  const YamlMap instrument = yaml.map("instrument");
  instrument.only({"primitives", "tip", "coupling"});
  scene.instrument = read_instrument(instrument);
  scene.coupling = read_coupling(instrument.map("coupling"));

  if (yaml.has("removal")) scene.removal = read_removal(yaml.map("removal"));
  const bool removable = std::any_of(scene.bodies.begin(), scene.bodies.end(),
                                     [](const SceneBody& body) { return body.removable; });
  if (scene.removal.rate > 0 && !removable)
    throw yaml.error("removal", "no body is removable (say removable: true for one, or rate: 0)");

  if (yaml.has("haptic")) scene.haptic_mode = read_haptic_mode(yaml.map("haptic"));
  read_device_of(yaml, device, scene);
  read_mapping(yaml.map("mapping"), scene.device);
  if (yaml.has("more_devices"))
    for (const YamlMap& entry : yaml.maps("more_devices"))
      scene.more_devices.push_back(read_further_device(entry, scene));

  scene.ros2 = yaml.flag("ros2", false);
  if (yaml.has("logging")) {
    const YamlMap logging = yaml.map("logging");
    logging.only({"level"});
    logging.choice("level", {"debug", "info", "warning", "error"});
    scene.log_level = logging.text("level");
  }
  if (yaml.has("trajectory")) {
    scene.trajectory = yaml.folder() / yaml.text("trajectory");
    if (!std::filesystem::is_regular_file(*scene.trajectory))
      throw yaml.error("trajectory", "no such file: " + scene.trajectory->string());
    read_trajectory(*scene.trajectory, LengthUnit::metre);
  }
  return scene;
}

}  // namespace hapticd
