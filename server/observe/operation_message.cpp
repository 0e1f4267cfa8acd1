#include "server/observe/operation_message.h"

#include "server/dds/borrowed.h"

namespace hapticd {

// Cyclone reads strings of a message that is written, and wants them writable.
hapticd_msg_SceneOperation operation_message(std::uint32_t device_id, const std::string& scene,
                                             const OperationMeasures& measures, std::uint64_t events,
                                             std::vector<hapticd_msg_HandOperation>& hands,
                                             std::vector<hapticd_msg_BodyOperation>& bodies) {
  const auto text = [](const char* t) { return const_cast<char*>(t); };
  const auto real = [](double x) { return static_cast<float>(x); };
  const auto count = [](int n) { return static_cast<std::uint32_t>(n); };
  hands.clear();
  bodies.clear();
  for (const HandMeasures& h : measures.hands)
    hands.push_back({real(h.path), real(h.touching), real(h.emulsifying), real(h.aspirating),
                     real(h.force_most), real(h.vacuum), real(h.flow), real(h.fluid), real(h.occluded),
                     real(h.incision_force), real(h.incision_stretch)});
  for (const BodyMeasures& b : measures.bodies)
    bodies.push_back({text(b.name.c_str()), b.deformable, real(b.volume > 0 ? b.volume_gone / b.volume : 0),
                      count(b.pieces), count(b.pieces_most), count(b.crumbs), count(b.loose),
                      real(b.strain_most), real(b.touched), real(b.touch_most)});
  hapticd_msg_SceneOperation m{};
  m.device_id = device_id;
  m.scene = text(scene.c_str());
  m.time = measures.time;
  m.hands = borrowed<decltype(m.hands)>(hands);
  m.bodies = borrowed<decltype(m.bodies)>(bodies);
  m.events = static_cast<std::uint32_t>(events);
  m.event = m.event_who = text("");
  if (!measures.events.empty()) {
    const OperationEvent& newest = measures.events.back();
    m.event_time = newest.time;
    m.event = text(newest.what);
    m.event_who = text(newest.who.c_str());
    m.event_value = newest.value;
  }
  return m;
}

}  // namespace hapticd
