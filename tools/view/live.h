// What a running daemon tells everybody, for the page: the scene, its status and its health, over DDS.
//
// It reads only what the daemon's diagnostics thread publishes; the forces and states that the haptic thread
// handles each millisecond stay out of it, so a viewer more sends that thread no packet more. A daemon counts
// as gone when no status has come for a second. Messages beside those of the scene (scene.h):
//   status     JSON: whether there is a daemon, and per device what ServerStatus says
//   health/D   JSON: what ServerHealth says of device D
//   operation  JSON: what the operation has come to (operation_json.h), of the world that is shown
// Times are this process's, since it was made [s]. Thread safety: one thread. Errors: std::runtime_error
// (DDS).
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "server/dds/dds.h"
#include "tools/view/scene.h"

namespace hapticd {

// As the page has it: {"kind": "status", …}. devices: by id.
std::string status_json(bool daemon, std::uint32_t domain,
                        const std::map<std::uint32_t, nlohmann::json>& devices);
nlohmann::json device_json(const hapticd_msg_ServerStatus& m);
std::string health_json(const hapticd_msg_ServerHealth& m);
SharedMessage operation_text(const hapticd_msg_SceneOperation& m);

class LiveSource {
 public:
  explicit LiveSource(const Participant& participant);

  // Takes what has come; what there is to say since the last time. `watched`: somebody looks; else the scene
  // waits.
  std::vector<SharedMessage> poll(bool watched);
  bool has_daemon() const noexcept { return daemon_; }
  // The newest, of the device of that id; null: none yet.
  const nlohmann::json* health(std::uint32_t device_id) const;

 private:
  double now() const;
  void take_scene();

  Reader<hapticd_msg_SceneGeometry> geometry_;
  Reader<hapticd_msg_SceneUpdate> update_;
  Reader<hapticd_msg_SceneInstrument> instrument_;
  Reader<hapticd_msg_ServerStatus> status_;
  Reader<hapticd_msg_ServerHealth> health_;
  Reader<hapticd_msg_SceneOperation> operation_;
  ViewScene scene_;
  std::map<std::uint32_t, nlohmann::json> devices_, health_of_;
  std::int64_t made_ns_, status_ns_ = 0;
  std::uint32_t domain_ = 0;
  std::optional<std::uint32_t> operation_of_;  // a world's first device
  bool daemon_ = false, said_ = false;
};

}  // namespace hapticd
