#include "server/scene/scene_instruments.h"

#include <algorithm>
#include <stdexcept>

#include "server/files/paths.h"
#include "server/record/trajectory_reader.h"
#include "server/scene/device_reader.h"
#include "server/scene/scene_bodies.h"
#include "server/scene/scene_reader.h"

namespace hapticd {
namespace {

constexpr std::size_t most_instruments = 4;
constexpr int largest_id = 1'000'000;

constexpr NumberRange stiffness{0, 1e6, true, false, "newtons per metre; about ten times the contact's own"};
constexpr NumberRange rotational_stiffness{0, 1e4, true, false, "newton metres per radian"};
constexpr NumberRange damping_time{0, 1, false, false, "seconds; about 0.002"};
constexpr NumberRange removal_rate{0, 1e5, false, false, "tetrahedra per second; 0: none"};
constexpr NumberRange reach{0, 0.1, false, false, "metres"};
constexpr NumberRange port_length{0, 0.1, true, false, "metres"};
constexpr NumberRange vacuum{0, 101325, false, false,
                             "pascals below the surroundings; a phaco machine's reach 80 kPa"};
constexpr NumberRange rise_time{0, 60, false, false, "seconds; the pump's time constant"};
constexpr NumberRange flow{0, 1e-4, false, false, "cubic metres per second; 30 ml/min are 5e-7"};
constexpr NumberRange position_scale{1e-3, 1e2, false, false,
                                     "scene metres per device metre; 0.1 for a small scene"};
constexpr NumberRange force_scale{0, 1e6, true, false, "device newtons per scene newton"};
constexpr NumberRange between_instruments{0, 2, false, false, "Coulomb's coefficient; 0: frictionless"};

Blade read_blade(const YamlMap& yaml) {
  yaml.only({"edge", "direction", "samples"});
  const std::vector<Vec3> edge = yaml.points("edge");
  const Vec3 direction = yaml.vec3("direction");
  if (direction.isZero(0)) throw yaml.error("direction", "is zero");
  const int samples = yaml.whole("samples", 1, max_edge_samples);
  try {
    return make_blade(edge, direction, samples);
  } catch (const std::invalid_argument& fault) {
    throw yaml.error("edge", fault.what());
  }
}

// The pump's keys stand in a map of their own, or, without a flow, among the port's.
void read_pump(const YamlMap& yaml, Port& port) {
  if (yaml.has("pump"))
    for (const char* key : {"vacuum", "rise_time"})
      if (yaml.has(key)) throw yaml.error(key, "stands in pump already");
  const YamlMap pump = yaml.has("pump") ? yaml.map("pump") : yaml;
  if (yaml.has("pump")) pump.only({"vacuum", "rise_time", "flow"});
  port.vacuum = pump.number("vacuum", vacuum);
  port.rise_time = pump.number("rise_time", rise_time);
  if (!yaml.has("pump")) return;
  port.flow = pump.number("flow", flow, 0);
  if (port.flow > 0 && !(port.rise_time > 0))
    throw pump.error("rise_time", "is zero: a pump with a flow needs the time in which its vacuum builds");
}

Port read_port(const YamlMap& yaml) {
  yaml.only({"position", "direction", "radius", "reach", "vacuum", "rise_time", "pump", "lumen"});
  Port port;
  port.position = yaml.vec3("position", Vec3::Zero());
  const Vec3 direction = yaml.vec3("direction", -Vec3::UnitZ());
  if (direction.isZero(0)) throw yaml.error("direction", "is zero");
  port.direction = direction.normalized();
  port.radius = yaml.number("radius", port_length);
  port.reach = yaml.number("reach", port_length);
  read_pump(yaml, port);
  if (yaml.has("lumen")) port.lumen = yaml.number("lumen", port_length);
  return port;
}

// Axis: as a pivot's, from the device's origin.
Incision read_incision(const YamlMap& yaml, const DeviceSettings& device) {
  yaml.only({"at", "axis", "slack", "stiffness", "friction"});
  Incision ring;
  ring.at = yaml.vec3("at");
  const Vec3 axis = yaml.vec3("axis", ring.at - device.origin);
  if (axis.isZero(0))
    throw yaml.has("axis") ? yaml.error("axis", "is zero")
                           : yaml.error("at", "is mapping.origin: say axis, the direction out of the body");
  ring.axis = axis.normalized();
  ring.slack = yaml.number("slack", port_length);
  ring.stiffness = yaml.number("stiffness", stiffness);
  ring.friction = yaml.number("friction", between_instruments, 0);
  if (device.pivot && (device.pivot->point - ring.at).norm() > ring.slack)
    throw yaml.error("at", "is farther than slack from mapping.pivot.point: the ring would always pull");
  return ring;
}

VirtualCoupling read_coupling(const YamlMap& yaml) {
  yaml.only({"stiffness", "rotational_stiffness", "damping_time"});
  VirtualCoupling coupling;
  coupling.stiffness = yaml.number("stiffness", stiffness);
  coupling.rotational_stiffness = yaml.number("rotational_stiffness", rotational_stiffness);
  coupling.damping_time = yaml.number("damping_time", damping_time);
  return coupling;
}

RemovalSettings read_removal(const YamlMap& yaml, const Port& port) {
  yaml.only({"rate", "law", "stroke", "aspiration"});
  RemovalSettings removal;
  removal.gradual = !yaml.has("law") || yaml.choice("law", {"instant", "gradual"}) == 1;
  removal.rate = yaml.number("rate", removal_rate);
  removal.stroke = yaml.number("stroke", reach, 0);
  if (yaml.has("aspiration")) {
    const YamlMap aspiration = yaml.map("aspiration");
    aspiration.only({"reach", "max_elements"});
    removal.aspiration_reach = aspiration.number("reach", reach);
    if (port.lumen <= 0)
      removal.aspiration_max_tets = aspiration.whole("max_elements", 0, 1'000'000);
    else if (aspiration.has("max_elements"))
      throw aspiration.error("max_elements", "stands where no port.lumen says what passes");
  }
  return removal;
}

std::filesystem::path device_file_of(const YamlMap& yaml) {
  const std::filesystem::path file = device_path(yaml.text("device"), yaml.folder());
  if (!is_file(file)) throw yaml.error("device", no_such_device(yaml.text("device"), file));
  return file;
}

// Of a name that stands on the command line, not in the scene.
std::filesystem::path device_file_of(const std::string& name) {
  const std::filesystem::path file = device_path(name, std::filesystem::current_path());
  if (!is_file(file)) throw InputError(file, 0, "device", no_such_device(name, file));
  return file;
}

std::uint32_t read_id(const YamlMap& yaml) {
  return static_cast<std::uint32_t>(yaml.whole("id", 0, largest_id));
}

Pivot read_pivot(const YamlMap& yaml, const DeviceSettings& device) {
  yaml.only({"point", "axis"});
  const Vec3 point = yaml.vec3("point"), axis = yaml.vec3("axis", point - device.origin);
  if (axis.isZero(0))
    throw yaml.has("axis")
        ? yaml.error("axis", "is zero")
        : yaml.error("point", "is mapping.origin: say axis, the direction out of the body");
  return {point, axis.normalized()};
}

void read_mapping(const YamlMap& yaml, DeviceSettings& device) {
  yaml.only({"position_scale", "force_scale", "origin", "frame", "tool", "pivot"});
  device.position_scale = yaml.number("position_scale", position_scale);
  device.force_scale = yaml.number("force_scale", force_scale);
  device.origin = yaml.vec3("origin", Vec3::Zero());
  device.frame = yaml.quaternion("frame");
  device.tool = yaml.quaternion("tool");
  if (yaml.has("pivot")) device.pivot = read_pivot(yaml.map("pivot"), device);
}

// own: where primitives, tip, blade and coupling stand; rest: where removal, device, mapping and trajectory
// do. An entry of a list is both.
SceneInstrument read_entry(const YamlMap& own, const YamlMap& rest, const std::string& device,
                           const std::vector<SceneBody>& bodies) {
  SceneInstrument held;
  held.shape = read_instrument(own);
  held.coupling = read_coupling(own.map("coupling"));
  if (own.has("blade")) held.shape.blade = read_blade(own.map("blade"));
  if (own.has("port")) held.shape.port = read_port(own.map("port"));
  const bool tough =
      std::any_of(bodies.begin(), bodies.end(), [](const SceneBody& body) { return body.toughness > 0; });
  if (own.has("blade") && !tough)
    throw own.error("blade", "no body can be cut (say toughness, in J/m², for one)");

  if (rest.has("removal")) held.removal = read_removal(rest.map("removal"), held.shape.port);
  const bool removable =
      std::any_of(bodies.begin(), bodies.end(), [](const SceneBody& body) { return body.removable; });
  if (held.removal.rate > 0 && !removable)
    throw rest.error("removal", "no body is removable (say removable: true for one, or rate: 0)");

  held.device_file = device.empty() ? device_file_of(rest) : device_file_of(device);
  const DeviceFile file = read_device(held.device_file);
  held.device = file.limits;
  held.device_name = file.name;
  held.device_stiffness = file.max_stiffness;
  read_mapping(rest.map("mapping"), held.device);
  if (own.has("incision")) held.shape.incision = read_incision(own.map("incision"), held.device);

  if (rest.has("trajectory")) {
    held.trajectory = rest.folder() / rest.text("trajectory");
    if (!is_file(*held.trajectory))
      throw rest.error("trajectory", "no such file: " + held.trajectory->string());
    read_trajectory(*held.trajectory, LengthUnit::metre);
  }
  return held;
}

SceneInstrument read_listed(const YamlMap& yaml, const std::string& device, const Scene& scene) {
  yaml.only({"name", "primitives", "tip", "blade", "port", "incision", "coupling", "removal", "device", "id",
             "mapping", "trajectory", "ghost"});
  const std::string name = yaml.text("name");
  for (const SceneInstrument& other : scene.instruments)
    if (other.name == name) throw yaml.error("name", "'" + name + "' is another instrument's name already");
  SceneInstrument held = read_entry(yaml, yaml, device, scene.bodies);
  held.name = name;
  if (yaml.has("id")) held.device.id = read_id(yaml);
  if (has_device(scene, held.device.id))
    throw yaml.error("id",
                     std::to_string(held.device.id) + " is another device's id already" +
                         (yaml.has("id") ? "" : " (its file's: give this instrument an id of its own)"));
  return held;
}

// own: of scene.instruments, which all are read.
Ghost read_ghost(const YamlMap& yaml, std::size_t own, const Scene& scene) {
  yaml.only({"of", "stiffness", "max_force"});
  const SceneInstrument& held = scene.instruments[own];
  const int id = yaml.whole("of", 0, largest_id);
  std::size_t of = 0;
  while (of < scene.instruments.size() && scene.instruments[of].device.id != static_cast<std::uint32_t>(id))
    ++of;
  if (of == own || of == scene.instruments.size())
    throw yaml.error("of", std::to_string(id) + (of == own ? " is this instrument's own device"
                                                           : " is no device of another instrument's"));
  const NumberRange displayed{0, held.device_stiffness, true, false,
                              "newtons per metre at the device; at most what it displays stably"};
  const NumberRange allowed{0, held.device.max_force, true, false, "newtons; at most the device's max_force"};
  return {static_cast<int>(of), yaml.number("stiffness", displayed), yaml.number("max_force", allowed)};
}

// A device's limits by name or path, with an id of its own.
DeviceSettings read_further_device(const YamlMap& yaml, const Scene& scene) {
  yaml.only({"device", "id", "mapping"});
  DeviceSettings device = read_device(device_file_of(yaml)).limits;
  device.id = read_id(yaml);
  if (has_device(scene, device.id))
    throw yaml.error("id", std::to_string(device.id) + " is another device's id already");
  read_mapping(yaml.map("mapping"), device);
  return device;
}

void read_only_instrument(const YamlMap& yaml, const std::string& device, Scene& scene) {
  if (yaml.has("instrument_friction"))
    throw yaml.error("instrument_friction",
                     "is of one instrument against another: stands only beside instruments");
  const YamlMap own = yaml.map("instrument");
  own.only({"primitives", "tip", "blade", "port", "incision", "coupling"});
  scene.instruments.push_back(read_entry(own, yaml, device, scene.bodies));
  scene.first().name = "instrument";
  if (yaml.has("more_devices"))
    for (const YamlMap& entry : yaml.maps("more_devices"))
      scene.more_devices.push_back(read_further_device(entry, scene));
}

void read_several(const YamlMap& yaml, const std::string& device, Scene& scene) {
  for (const char* other : {"instrument", "removal", "device", "mapping", "trajectory", "more_devices"})
    if (yaml.has(other))
      throw yaml.error(other, "cannot stand beside instruments: each of them has its own device and keys");
  const std::vector<YamlMap> entries = yaml.maps("instruments");
  if (entries.size() > most_instruments)
    throw yaml.error("instruments", std::to_string(entries.size()) + " are too many: one tissue has one to " +
                                        std::to_string(most_instruments));
  for (const YamlMap& entry : entries)
    scene.instruments.push_back(read_listed(entry, scene.instruments.empty() ? device : "", scene));
  for (std::size_t i = 0; i < entries.size(); ++i)
    if (entries[i].has("ghost"))
      scene.instruments[i].device.ghost = read_ghost(entries[i].map("ghost"), i, scene);
  scene.instrument_friction = yaml.number("instrument_friction", between_instruments, 0);
}

}  // namespace

void read_instruments(const YamlMap& yaml, const std::string& device, Scene& scene) {
  scene.instruments.clear();
  yaml.has("instruments") ? read_several(yaml, device, scene) : read_only_instrument(yaml, device, scene);
}

bool has_device(const Scene& scene, std::uint32_t id) {
  const auto has_id = [id](const DeviceSettings& device) { return device.id == id; };
  return std::any_of(scene.instruments.begin(), scene.instruments.end(),
                     [&](const SceneInstrument& held) { return has_id(held.device); }) ||
         std::any_of(scene.more_devices.begin(), scene.more_devices.end(), has_id);
}

void require_instruments_of(const Scene& scene, const std::vector<std::uint32_t>& ids,
                            const std::string& option) {
  for (const std::uint32_t id : ids) {
    std::string known;
    bool found = false;
    for (const SceneInstrument& held : scene.instruments) {
      found = found || held.device.id == id;
      known += (known.empty() ? "" : ", ") + std::to_string(held.device.id);
    }
    if (!found)
      throw InputError(scene.file, 0, option,
                       std::to_string(id) + " is no instrument's device; there are: " + known);
  }
}

void add_device(Scene& scene, const std::string& name) {
  if (scene.instruments.size() > 1)
    throw InputError(scene.file, 0, "instruments",
                     "further devices with tissue of their own need a scene with one instrument");
  const DeviceSettings limits = read_device(device_file_of(name)).limits;
  DeviceSettings device = scene.first().device;  // its map into the scene
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

}  // namespace hapticd
