#include "server/schedule/scene_fingerprint.h"

#include <cstring>

namespace hapticd {
namespace {

class Fingerprint {
 public:
  template <typename T>
  void add(const T& value) {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    unsigned char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    for (const unsigned char b : bytes) hash_ = (hash_ ^ b) * 0x100000001b3;  // FNV-1a
  }
  void add(const Vec3& v) {
    for (int i = 0; i < 3; ++i) add(v[i]);
  }
  void add(const Pose& X) {
    add(X.p);
    for (int i = 0; i < 4; ++i) add(X.q.coeffs()[i]);
  }
  std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325;
};

void add(Fingerprint& f, const SceneInstrument& i) {
  for (const double x : {i.coupling.stiffness, i.coupling.rotational_stiffness, i.coupling.damping_time,
                         i.removal.rate, i.removal.stroke, i.removal.aspiration_reach})
    f.add(x);
  f.add(i.removal.aspiration_max_tets);
  f.add(i.removal.gradual);
  for (const Primitive& p : i.shape.primitives) {
    f.add(p.shape);
    f.add(p.radius);
    f.add(p.half_length);
    f.add(p.placement);
    for (const Vec3& v : p.vertices) f.add(v);
  }
  f.add(i.shape.tip);
  const Port& port = i.shape.port;
  f.add(port.position);
  f.add(port.direction);
  for (const double x : {port.radius, port.reach, port.vacuum, port.rise_time, port.flow, port.lumen})
    f.add(x);
  const Incision& ring = i.shape.incision;
  f.add(ring.at);
  f.add(ring.axis);
  for (const double x : {ring.slack, ring.stiffness, ring.friction}) f.add(x);
}

}  // namespace

std::uint64_t fingerprint(const Scene& s) {
  Fingerprint f;
  for (const double x : {s.rate, s.alarm_distance, s.sample_spacing, s.instrument_friction}) f.add(x);
  for (const SceneInstrument& i : s.instruments) add(f, i);
  f.add(s.gravity);
  f.add(s.compliance);
  f.add(s.contact);
  f.add(s.friction);
  for (const SceneBody& b : s.bodies) {
    f.add(b.kind);
    for (const Vec3& x : b.mesh.nodes) f.add(x);
    for (const Tet& t : b.mesh.tets)
      for (const int n : t) f.add(n);
    for (const double x : {b.material.young, b.material.poisson, b.material.density, b.material.rayleigh_mass,
                           b.material.rayleigh_stiffness, b.friction})
      f.add(x);
    f.add(b.material.law);
    for (const int n : b.fixed_nodes) f.add(n);
    for (const TissueRegion& r : b.regions) {
      for (const double x : {r.material.young, r.material.poisson, r.material.density}) f.add(x);
      f.add(r.stretch);
      for (const int t : r.tets) f.add(t);
    }
    for (const NodeSpring& spring : b.springs) {
      f.add(spring.stiffness);
      f.add(spring.anchor);
    }
    if (b.near) {
      f.add(b.near->centre);
      f.add(b.near->radius);
      f.add(b.near->follows);
    }
    for (const bool flag : {b.removable, b.corotational, b.dynamic, b.simulated}) f.add(flag);
  }
  for (const ContactPair& p : s.contacts) {
    f.add(p.points);
    f.add(p.faces);
    f.add(p.friction);
  }
  return f.value();
}

}  // namespace hapticd
