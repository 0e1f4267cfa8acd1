#include "tools/view/live.h"

#include <span>

#include "haptic/clock.h"
#include "tools/view/operation_json.h"
#include "tools/view/page_service.h"

namespace hapticd {
namespace {

constexpr std::int64_t silence_ns = 1'000'000'000;

template <typename Sequence>
auto span_of(const Sequence& s) {
  return std::span(s._buffer, s._length);
}

template <typename Sequence>
nlohmann::json list_of(const Sequence& s) {
  nlohmann::json out = nlohmann::json::array();
  for (const auto value : span_of(s)) out.push_back(value);
  return out;
}

TetMesh mesh_of(const hapticd_msg_SceneGeometry& m) {
  TetMesh mesh;
  for (std::uint32_t i = 0; i + 2 < m.nodes._length; i += 3)
    mesh.nodes.emplace_back(m.nodes._buffer[i], m.nodes._buffer[i + 1], m.nodes._buffer[i + 2]);
  for (std::uint32_t i = 0; i + 3 < m.tets._length; i += 4) {
    const std::uint32_t* t = m.tets._buffer + i;
    bool fits = true;
    for (int a = 0; a < 4; ++a) fits = fits && t[a] < mesh.nodes.size();
    if (fits) mesh.tets.push_back({int(t[0]), int(t[1]), int(t[2]), int(t[3])});
  }
  return mesh;
}

}  // namespace

nlohmann::json device_json(const hapticd_msg_ServerStatus& m) {
  return {{"id", m.device_id},
          {"scene", m.scene ? m.scene : ""},
          {"step", m.step},
          {"ticks", m.ticks},
          {"misses", m.deadline_misses},
          {"haptic_hz", m.haptic_rate_hz},
          {"sim_hz", m.sim_rate_hz},
          {"step_ms", m.sim_step_ms},
          {"removed", m.elements_removed},
          {"aspirated", m.fragments_aspirated},
          {"status", m.status},
          {"rejected", m.rejected_states},
          {"conflicts", m.conflicts},
          {"refused", m.refused ? m.refused : ""}};
}

std::string status_json(bool daemon, std::uint32_t domain,
                        const std::map<std::uint32_t, nlohmann::json>& devices) {
  nlohmann::json list = nlohmann::json::array();
  for (const auto& [id, device] : devices) list.push_back(device);
  return nlohmann::json{{"kind", "status"}, {"daemon", daemon}, {"domain", domain}, {"devices", list}}.dump();
}

std::string health_json(const hapticd_msg_ServerHealth& m) {
  nlohmann::json bodies = nlohmann::json::array();
  for (const hapticd_msg_BodyHealth& b : span_of(m.bodies))
    bodies.push_back({{"body", b.body},
                      {"awake", b.awake},
                      {"degraded", b.degraded},
                      {"reference_age", b.reference_age},
                      {"removed", b.removed_since_reference},
                      {"error", b.error}});
  return nlohmann::json{{"kind", "health"},
                        {"id", m.device_id},
                        {"device", m.device ? m.device : ""},
                        {"compliance", m.compliance ? m.compliance : ""},
                        {"blocks", m.blocks},
                        {"force", list_of(m.force)},
                        {"wake", list_of(m.wake)},
                        {"solve", list_of(m.solve)},
                        {"energy", m.energy},
                        {"energy_least", m.energy_least},
                        {"parts_ms", m.step_part_ms},
                        {"period_ms", m.step_period_ms},
                        {"bodies", bodies},
                        {"max_force", m.max_force},
                        {"max_speed", m.max_speed},
                        {"workspace", m.workspace_radius},
                        {"position_scale", m.position_scale},
                        {"force_scale", m.force_scale},
                        {"origin", m.origin},
                        {"frame", m.frame},
                        {"tool", m.tool}}
      .dump();
}

SharedMessage operation_text(const hapticd_msg_SceneOperation& m) {
  nlohmann::ordered_json json = operation_json(m);
  json["kind"] = "operation";
  return page_text("operation", json.dump());
}

LiveSource::LiveSource(const Participant& participant)
    : geometry_(participant),
      update_(participant),
      instrument_(participant),
      status_(participant),
      health_(participant),
      operation_(participant),
      made_ns_(monotonic_ns()) {
  dds_domainid_t id = 0;
  if (dds_get_domainid(participant.handle(), &id) == DDS_RETCODE_OK) domain_ = id;
}

double LiveSource::now() const { return 1e-9 * static_cast<double>(monotonic_ns() - made_ns_); }

const nlohmann::json* LiveSource::health(std::uint32_t device_id) const {
  const auto found = health_of_.find(device_id);
  return found == health_of_.end() ? nullptr : &found->second;
}

void LiveSource::take_scene() {
  geometry_.take_each([this](const hapticd_msg_SceneGeometry& m, const dds_sample_info_t&) {
    const auto opened = span_of(m.opened);
    scene_.tell_body(m.body, m.name ? m.name : "", m.deformable, mesh_of(m), {opened.begin(), opened.end()});
  });
  instrument_.take_each([this](const hapticd_msg_SceneInstrument& m, const dds_sample_info_t&) {
    const auto p = span_of(m.primitives);
    scene_.tell_instrument(m.instrument, m.instruments,
                           {m.name ? m.name : "", m.device_id, {p.begin(), p.end()}});
  });
  update_.take_each([this](const hapticd_msg_SceneUpdate& m, const dds_sample_info_t&) {
    scene_.tell_motion(m.body, now(), span_of(m.nodes), span_of(m.alive));
    scene_.tell_contacts(now(), span_of(m.instruments), span_of(m.contacts), span_of(m.pressing));
  });
}

std::vector<SharedMessage> LiveSource::poll(bool watched) {
  take_scene();
  std::vector<SharedMessage> out;
  if (watched) out = scene_.messages();
  health_.take_each([&](const hapticd_msg_ServerHealth& m, const dds_sample_info_t&) {
    std::string json = health_json(m);
    health_of_[m.device_id] = nlohmann::json::parse(json);
    out.push_back(page_text("health/" + std::to_string(m.device_id), std::move(json)));
  });
  // Of devices with a tissue each the first one's is shown.
  operation_.take_each([&](const hapticd_msg_SceneOperation& m, const dds_sample_info_t&) {
    if (!operation_of_ || m.device_id <= *operation_of_) {
      operation_of_ = m.device_id;
      out.push_back(operation_text(m));
    }
  });
  const std::int64_t now_ns = monotonic_ns();
  bool news = !said_;
  status_.take_each([&](const hapticd_msg_ServerStatus& m, const dds_sample_info_t&) {
    devices_[m.device_id] = device_json(m);
    status_ns_ = now_ns;
    news = true;
  });
  const bool daemon = status_ns_ > 0 && now_ns - status_ns_ < silence_ns;
  if (daemon != daemon_ && !daemon) {
    devices_.clear();
    operation_of_.reset();
  }
  news = news || daemon != daemon_;
  daemon_ = daemon;
  said_ = true;
  if (news) out.push_back(page_text("status", status_json(daemon, domain_, devices_)));
  return out;
}

}  // namespace hapticd
