#include "server/scene_reader.h"

#include <algorithm>

#include "server/device_reader.h"
#include "server/paths.h"
#include "server/scene_bodies.h"
#include "server/trajectory_reader.h"

namespace hapticd {
namespace {

constexpr NumberRange rate{1, 500, false, false, "simulation steps per second; 50 is usual"};
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
  if (yaml.has("compliance"))
    scene.compliance = compliance_methods[yaml.choice("compliance", {"exact", "zone", "lazy", "updown"})];
  if (yaml.has("contact"))
    scene.contact = yaml.choice("contact", {"renewed", "frozen"}) == 0 ? Renewal::renewed : Renewal::frozen;
  scene.alarm_distance = yaml.number("alarm_distance", alarm_distance);
  scene.sample_spacing = yaml.number("sample_spacing", sample_spacing);
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

}  // namespace

Scene read_scene(const std::filesystem::path& file, const std::string& device) {
  const YamlMap yaml = YamlMap::open(file);
  yaml.only({"scene", "simulation", "gravity", "bodies", "instrument", "removal", "device", "mapping",
             "trajectory", "ros2"});
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
    scene.bodies.push_back(std::move(body));
  }

  const YamlMap instrument = yaml.map("instrument");
  instrument.only({"primitives", "tip", "coupling"});
  scene.instrument = read_instrument(instrument);
  scene.coupling = read_coupling(instrument.map("coupling"));

  if (yaml.has("removal")) scene.removal = read_removal(yaml.map("removal"));
  const bool removable = std::any_of(scene.bodies.begin(), scene.bodies.end(),
                                     [](const SceneBody& body) { return body.removable; });
  if (scene.removal.rate > 0 && !removable)
    throw yaml.error("removal", "no body is removable (say removable: true for one, or rate: 0)");

  read_device_of(yaml, device, scene);
  read_mapping(yaml.map("mapping"), scene.device);

  scene.ros2 = yaml.flag("ros2", false);
  if (yaml.has("trajectory")) {
    scene.trajectory = yaml.folder() / yaml.text("trajectory");
    if (!std::filesystem::is_regular_file(*scene.trajectory))
      throw yaml.error("trajectory", "no such file: " + scene.trajectory->string());
    read_trajectory(*scene.trajectory, LengthUnit::metre);
  }
  return scene;
}

}  // namespace hapticd
