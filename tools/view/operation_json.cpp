#include "tools/view/operation_json.h"

#include <cmath>
#include <cstdint>

#include "tools/cli/report.h"

namespace hapticd {
namespace {

using Json = nlohmann::ordered_json;

Json real(double x, int decimals) { return std::isfinite(x) ? Json(rounded(x, decimals)) : Json(nullptr); }
const char* text(const char* of) { return of ? of : ""; }

}  // namespace

Json operation_json(const hapticd_msg_SceneOperation& m) {
  Json j = {{"device_id", m.device_id}, {"scene", text(m.scene)}, {"time_s", real(m.time, 1)}};
  for (std::uint32_t i = 0; i < m.hands._length; ++i) {
    const hapticd_msg_HandOperation& h = m.hands._buffer[i];
    j["hands"].push_back({{"path_m", real(h.path, 4)},
                          {"touching_s", real(h.touching, 1)},
                          {"emulsifying_s", real(h.emulsifying, 1)},
                          {"aspirating_s", real(h.aspirating, 1)},
                          {"sim_force_most_n", real(h.force_most, 3)},
                          {"vacuum_pa", real(h.vacuum, 0)},
                          {"flow_ml_per_min", real(6e7 * h.flow, 1)},
                          {"fluid_ml", real(1e6 * h.fluid, 2)},
                          {"occluded_s", real(h.occluded, 1)},
                          {"incision",
                           {{"sim_force_most_n", real(h.incision_force, 5)},
                            {"stretch_most_m", real(h.incision_stretch, 7)}}}});
  }
  for (std::uint32_t i = 0; i < m.bodies._length; ++i) {
    const hapticd_msg_BodyOperation& b = m.bodies._buffer[i];
    Json of = {
        {"name", text(b.name)}, {"touched_s", real(b.touched, 1)}, {"touch_most_n", real(b.touch_most, 3)}};
    if (b.deformable)
      of.update({{"volume_gone_share", real(b.volume_gone, 4)},
                 {"pieces", b.pieces},
                 {"pieces_most", b.pieces_most},
                 {"crumbs", b.crumbs},
                 {"pieces_loose", b.loose},
                 {"strain_most", real(b.strain_most, 3)}});
    j["bodies"].push_back(std::move(of));
  }
  j["events"] = m.events;
  if (m.events > 0)
    j["newest_event"] = {{"t", real(m.event_time, 2)},
                         {"what", text(m.event)},
                         {"who", text(m.event_who)},
                         {"value", real(m.event_value, 3)}};
  return j;
}

}  // namespace hapticd
