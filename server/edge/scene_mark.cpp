#include "server/edge/scene_mark.h"

#include <bit>

#include "server/scene/scene_world.h"

namespace hapticd {
namespace {

// FNV-1a.
class Mark {
 public:
  void put(std::uint64_t n) {
    for (int byte = 0; byte < 8; ++byte) {
      value_ ^= n >> (8 * byte) & 0xff;
      value_ *= 0x100000001b3;
    }
  }
  void put(double x) { put(std::bit_cast<std::uint64_t>(x)); }
  void put(const Vec3& x) {
    for (int i = 0; i < 3; ++i) put(x[i]);
  }
  void put(const Primitive& p) {
    put(static_cast<std::uint64_t>(p.shape));
    put(p.radius);
    put(p.half_length);
    put(p.placement.p);
    for (int i = 0; i < 4; ++i) put(p.placement.q.coeffs()[i]);
    for (const Vec3& v : p.vertices) put(v);
  }
  void put(const Port& p) {
    put(p.position);
    put(p.direction);
    for (const double x : {p.radius, p.reach, p.vacuum, p.rise_time, p.flow, p.lumen}) put(x);
  }
  void put(const Incision& ring) {
    put(ring.at);
    put(ring.axis);
    for (const double x : {ring.slack, ring.stiffness, ring.friction}) put(x);
  }
  std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325;
};

}  // namespace

std::uint64_t scene_mark(const Scene& scene, const EachInstrument<bool>& at_simulation) {
  Mark mark;
  for (const bool there : at_simulation.value) mark.put(std::uint64_t{there});
  for (const SceneInstrument& i : scene.instruments) {
    mark.put(std::uint64_t{i.device.id});
    for (const Primitive& p : i.shape.primitives) mark.put(p);
    for (const BladePoint& p : i.shape.blade.sample) mark.put(p.place);
    mark.put(i.shape.blade.direction);
    mark.put(i.shape.port);
    mark.put(i.shape.incision);
  }
  const HapticOptions options = haptic_options(scene);
  mark.put(options.contact.margin);
  mark.put(options.viscous.step);
  for (const double relaxation : options.viscous.relaxation) mark.put(relaxation);
  return mark.value();
}

}  // namespace hapticd
