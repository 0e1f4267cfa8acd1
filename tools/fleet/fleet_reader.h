// Hears every station of a domain and tells a Fleet (fleet.h): status, health and operation, over DDS.
//
// It reads as an onlooker (onlooker_qos, server/dds/dds.h): best effort, so that no station waits for it or
// answers it, and in all partitions. A message's station is the partition of the writer that it came from,
// and its host what that writer's participant says of itself: daemons need not know of this. Thread safety:
// one thread. Errors: the constructor throws std::runtime_error (DDS).
#pragma once

#include <optional>

#include "server/dds/dds.h"
#include "tools/fleet/fleet.h"

namespace hapticd {

class FleetReader {
 public:
  explicit FleetReader(const Participant& participant);

  // Takes what has come, and what is gone; then looks (Fleet::look), and returns whose state changed.
  std::vector<std::string> poll();
  const Fleet& fleet() const noexcept { return fleet_; }

 private:
  template <typename T>
  struct Topic {
    explicit Topic(const Participant& participant) : reader(participant, onlooker_qos()) {}
    Reader<T> reader;
    std::map<dds_instance_handle_t, Origin> writers;
    int matched = 0;
  };

  template <typename T>
  void take(Topic<T>& topic, std::int64_t now_ns);
  template <typename T>
  const Origin* origin(Topic<T>& topic, dds_instance_handle_t writer);
  std::string host_of(dds_instance_handle_t participant) const;

  DdsEntity participants_;
  Topic<hapticd_msg_ServerStatus> status_;
  Topic<hapticd_msg_ServerHealth> health_;
  Topic<hapticd_msg_SceneOperation> operation_;
  Fleet fleet_;
};

}  // namespace hapticd
