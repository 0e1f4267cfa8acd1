#include "server/scene/scene_describe.h"

#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <numbers>

#include "server/record/trajectory_reader.h"

namespace hapticd {
namespace {

__attribute__((format(printf, 2, 3))) void line(std::string& out, const char* format, ...) {
  char text[512];
  std::va_list values;
  va_start(values, format);
  std::vsnprintf(text, sizeof text, format, values);
  va_end(values);
  out += text;
  out += '\n';
}

const char* shape_name(Shape shape) {
  static const char* const names[] = {"sphere", "capsule", "cylinder", "convex"};
  return names[static_cast<int>(shape)];
}

// Mean edge length: the resolution of a mesh [m].
double mean_edge(const TetMesh& mesh) {
  double sum = 0;
  for (const Tet& t : mesh.tets)
    for (int a = 0; a < 4; ++a)
      for (int b = 0; b < a; ++b) sum += (mesh.nodes[t[a]] - mesh.nodes[t[b]]).norm();
  return sum / (6.0 * static_cast<double>(mesh.tets.size()));
}

void describe_parts(std::string& out, const SceneBody& body) {
  for (const TissueRegion& r : body.regions)
    line(
        out,
        "           region of %zu tetrahedra: E %.4g Pa, nu %.3g, density %.4g kg/m3, stretch %.3g %.3g %.3g",
        r.tets.size(), r.material.young, r.material.poisson, r.material.density, r.stretch.x(), r.stretch.y(),
        r.stretch.z());
  double stiffness = 0;
  int nodes = 0;
  for (const NodeSpring& spring : body.springs) {
    stiffness += spring.stiffness;
    nodes += spring.stiffness > 0;
  }
  if (nodes > 0) line(out, "           springs on %d nodes, %.4g N/m together", nodes, stiffness);
  if (body.near)
    line(out, "           simulated within %.3g mm of %s(%.3g, %.3g, %.3g) mm", 1e3 * body.near->radius,
         body.near->follows ? "the instrument, at first of " : "", 1e3 * body.near->centre.x(),
         1e3 * body.near->centre.y(), 1e3 * body.near->centre.z());
}

void describe_body(std::string& out, const SceneBody& body) {
  line(out, "body       %s: %s, %zu nodes, %zu tetrahedra, mean edge %.2f mm", body.name.c_str(),
       body.kind == BodyKind::rigid ? "rigid obstacle"
       : !body.simulated            ? "deformable, not simulated: an obstacle"
       : body.removable             ? "deformable, removable"
                                    : "deformable",
       body.mesh.nodes.size(), body.mesh.tets.size(), 1e3 * mean_edge(body.mesh));
  if (body.kind == BodyKind::deformable) {
    const Material& m = body.material;
    line(out, "           E %.4g Pa, nu %.3g, density %.4g kg/m3, damping alpha %.3g 1/s, beta %.3g s",
         m.young, m.poisson, m.density, m.rayleigh_mass, m.rayleigh_stiffness);
    if (m.law == Law::guarded)
      line(out, "           guarded: elements that lose their volume are pushed back");
    describe_parts(out, body);
    if (body.fixed_nodes.empty() && body.springs.empty())
      line(out, "           floating");
    else if (!body.fixed_nodes.empty())
      line(out, "           %zu fixed nodes", body.fixed_nodes.size());
  }
  if (body.friction > 0) line(out, "           friction %.3g", body.friction);
  if (body.toughness > 0)
    line(out, "           toughness %.4g J/m2, room for %d new nodes%s", body.toughness, body.max_new_nodes,
         body.tearing.toughness > 0 ? ", tears" : "");
  if (body.cutting_viscosity > 0)
    line(out, "           cutting viscosity %.4g N s/m2", body.cutting_viscosity);
}

void describe_primitive(std::string& out, const Primitive& p, bool tip) {
  if (p.shape == Shape::convex)
    line(out, "           %s: convex, %zu vertices%s", p.name.c_str(), p.vertices.size(),
         tip ? " (tip)" : "");
  else if (p.shape == Shape::sphere)
    line(out, "           %s: sphere, radius %.2f mm%s", p.name.c_str(), 1e3 * p.radius, tip ? " (tip)" : "");
  else
    line(out, "           %s: %s, radius %.2f mm, axis %.2f mm%s", p.name.c_str(), shape_name(p.shape),
         1e3 * p.radius, 2e3 * p.half_length, tip ? " (tip)" : "");
}

std::string largest_aspirated(const SceneInstrument& held) {
  if (held.shape.port.lumen <= 0) return std::to_string(held.removal.aspiration_max_tets);
  char text[64];
  std::snprintf(text, sizeof text, "a lumen of radius %.2f mm", 1e3 * held.shape.port.lumen);
  return text;
}

void describe_instrument(std::string& out, const SceneInstrument& held, const Scene& scene) {
  const bool named = scene.instruments.size() > 1;
  const std::vector<Primitive>& primitives = held.shape.primitives;
  line(out, "instrument %s%zu primitives", named ? (held.name + ": ").c_str() : "", primitives.size());
  for (std::size_t i = 0; i < primitives.size(); ++i)
    describe_primitive(out, primitives[i], static_cast<int>(i) == held.shape.tip);
  const Blade& blade = held.shape.blade;
  double width = 0;
  for (const BladePoint& point : blade.sample) width += point.width;
  if (!blade.sample.empty())
    line(out, "blade      %.2f mm wide, %zu samples", 1e3 * width, blade.sample.size());
  if (const Port& port = held.shape.port; port.radius > 0)
    line(out, "port       radius %.2f mm, vacuum to %.3g kPa with %.2g s: at most %.3g mN", 1e3 * port.radius,
         1e-3 * port.vacuum, port.rise_time,
         1e3 * port.vacuum * std::numbers::pi * port.radius * port.radius);
  if (const Port& port = held.shape.port; port.flow > 0)
    line(out, "pump       %.3g ml/min, tubing %.3g mm3/kPa", 6e7 * port.flow,
         1e12 * port.flow * port.rise_time / port.vacuum);
  if (const Incision& ring = held.shape.incision; ring.stiffness > 0)
    line(out, "incision   ring at (%.2f, %.2f, %.2f) mm, slack %.0f um, %.4g N/m, friction %.3g",
         1e3 * ring.at.x(), 1e3 * ring.at.y(), 1e3 * ring.at.z(), 1e6 * ring.slack, ring.stiffness,
         ring.friction);
  line(out, "coupling   %.4g N/m, %.3g N m/rad, damping time %.3g ms", held.coupling.stiffness,
       held.coupling.rotational_stiffness, 1e3 * held.coupling.damping_time);
  const RemovalSettings& removal = held.removal;
  if (removal.rate > 0)
    line(out,
         "removal    %.4g tetrahedra/s, %s, stroke %.2f mm; fragments of up to %s within %.2f mm are "
         "aspirated",
         removal.rate, removal.gradual ? "by degrees" : "each at once", 1e3 * removal.stroke,
         largest_aspirated(held).c_str(), 1e3 * removal.aspiration_reach);
  const DeviceSettings& d = held.device;
  line(out, "device     %s%s: %.3g N, %.3g N m, %.4g N/s, %.3g m/s, workspace radius %.0f mm, %.4g N/m",
       held.device_name.c_str(), named ? (", id " + std::to_string(d.id)).c_str() : "", d.max_force,
       d.max_torque, d.max_force_rate, d.max_speed, 1e3 * d.workspace_radius, held.device_stiffness);
  line(out, "mapping    position x %.4g, force x %.4g", d.position_scale, d.force_scale);
  if (d.pivot)
    line(out, "pivot      the shaft passes through (%.2f, %.2f, %.2f) mm, whatever the stylus says",
         1e3 * d.pivot->point.x(), 1e3 * d.pivot->point.y(), 1e3 * d.pivot->point.z());
  if (d.ghost)
    line(out, "ghost      a spring to %s: %.4g N/m at the device, at most %.3g N",
         scene.instruments[static_cast<std::size_t>(d.ghost->of)].name.c_str(), d.ghost->stiffness,
         d.ghost->max_force);
  const double felt = felt_stiffness(held);
  line(out, "felt       stiffness at most %.4g N/m (coupling x position x force)%s", felt,
       felt > 1.001 * held.device_stiffness ? ": MORE than the device displays stably" : "");
  if (held.trajectory) {
    const Trajectory trajectory = read_trajectory(*held.trajectory, LengthUnit::metre);
    line(out, "trajectory %s: %.1f s, %zu samples", held.trajectory->string().c_str(),
         trajectory.end() - trajectory.begin(), trajectory.samples.size());
  }
}

}  // namespace

const char* compliance_name(ComplianceMethod method) {
  static const char* const names[] = {"exact", "zone", "lazy", "updown", "dense"};
  return names[static_cast<int>(method)];
}

double felt_stiffness(const SceneInstrument& held) {
  return held.coupling.stiffness * held.device.position_scale * held.device.force_scale;
}

std::string describe(const Scene& scene) {
  std::string out;
  line(out, "scene      %s (%s)", scene.name.c_str(), scene.file.string().c_str());
  line(out, "step       h = %.3g ms (%.4g Hz), compliance %s, contact %s", 1e3 / scene.rate, scene.rate,
       compliance_name(scene.compliance), scene.contact == Renewal::renewed ? "renewed" : "frozen");
  line(out, "contact    alarm distance %.2f mm, samples %.2f mm apart", 1e3 * scene.alarm_distance,
       1e3 * scene.sample_spacing);
  for (const SceneBody& body : scene.bodies) describe_body(out, body);
  for (const ContactPair& pair : scene.contacts)
    line(out, "touching   nodes of %s on faces of %s, friction %.3g", scene.bodies[pair.points].name.c_str(),
         scene.bodies[pair.faces].name.c_str(), pair.friction);
  for (const SceneInstrument& held : scene.instruments) describe_instrument(out, held, scene);
  if (scene.instrument_friction > 0)
    line(out, "touching   instruments among themselves, friction %.3g", scene.instrument_friction);
  for (const DeviceSettings& more : scene.more_devices)
    line(out, "device     id %u beside it, with tissue of its own: %.3g N, %.4g N/s", more.id, more.max_force,
         more.max_force_rate);
  if (scene.ros2)
    line(out, "ros2       rt/haptic/%u/pose, /twist, /wrench at 50 Hz", scene.first().device.id);
  return out;
}

nlohmann::ordered_json instruments_to_json(const Scene& scene) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const SceneInstrument& held : scene.instruments)
    json.push_back({{"name", held.name},
                    {"device", held.device_name},
                    {"id", held.device.id},
                    {"felt_stiffness", felt_stiffness(held)},
                    {"device_stiffness", held.device_stiffness},
                    {"removes", held.removal.rate > 0}});
  return json;
}

}  // namespace hapticd
