#include "tools/fleet/fleet_reader.h"

#include <algorithm>
#include <cstring>
#include <memory>

#include "haptic/clock.h"

namespace hapticd {
namespace {

using Endpoint = std::unique_ptr<dds_builtintopic_endpoint_t, decltype(&dds_builtintopic_free_endpoint)>;

// Null: there is no such writer any more.
Endpoint endpoint_of(dds_entity_t reader, dds_instance_handle_t writer) {
  return {dds_get_matched_publication_data(reader, writer), &dds_builtintopic_free_endpoint};
}

std::string partition_of(const dds_qos_t* qos) {
  std::uint32_t count = 0;
  char** names = nullptr;
  if (!dds_qget_partition(qos, &count, &names)) return {};
  const std::string first = count > 0 ? names[0] : "";
  for (std::uint32_t i = 0; i < count; ++i) dds_free(names[i]);
  dds_free(names);
  return first;
}

}  // namespace

FleetReader::FleetReader(const Participant& participant)
    : participants_(require(
          dds_create_reader(participant.handle(), DDS_BUILTIN_TOPIC_DCPSPARTICIPANT, nullptr, nullptr),
          "reader of participants")),
      status_(participant),
      health_(participant),
      operation_(participant) {}

// Cyclone's participants have it among their properties; "": this one does not.
std::string FleetReader::host_of(dds_instance_handle_t participant) const {
  void* sample[1] = {nullptr};
  dds_sample_info_t info[1];
  const dds_return_t n = dds_read_instance(participants_.handle(), sample, info, 1, 1, participant);
  if (n <= 0) return {};
  std::string host;
  char* value = nullptr;
  const auto* of = static_cast<const dds_builtintopic_participant_t*>(sample[0]);
  if (info[0].valid_data && dds_qget_prop(of->qos, "__Hostname", &value)) {
    host = value;
    dds_free(value);
  }
  dds_return_loan(participants_.handle(), sample, n);
  return host;
}

template <typename T>
const Origin* FleetReader::origin(Topic<T>& topic, dds_instance_handle_t writer) {
  const auto known = topic.writers.find(writer);
  if (known != topic.writers.end()) return &known->second;
  const Endpoint endpoint = endpoint_of(topic.reader.handle(), writer);
  if (!endpoint) return nullptr;
  Origin origin{partition_of(endpoint->qos), host_of(endpoint->participant_instance_handle), {}};
  static_assert(sizeof endpoint->participant_key.v == sizeof origin.program);
  std::memcpy(origin.program.data(), endpoint->participant_key.v, origin.program.size());
  return &topic.writers.emplace(writer, std::move(origin)).first->second;
}

template <typename T>
void FleetReader::take(Topic<T>& topic, std::int64_t now_ns) {
  const auto hear = [&](const T& m, const dds_sample_info_t& info) {
    if (const Origin* of = origin(topic, info.publication_handle)) fleet_.hear(*of, m, now_ns);
  };
  while (topic.reader.take_each(hear) > 0) {
  }
  const int matched = topic.reader.matched();
  if (matched == std::exchange(topic.matched, matched)) return;
  // Whoever has written and is no longer there has left.
  std::erase_if(topic.writers, [&](const auto& writer) {
    if (endpoint_of(topic.reader.handle(), writer.first)) return false;
    if constexpr (std::is_same_v<T, hapticd_msg_ServerStatus>) fleet_.leave(writer.second.program);
    return true;
  });
}

std::vector<std::string> FleetReader::poll() {
  const std::int64_t now_ns = monotonic_ns();
  take(status_, now_ns);
  take(health_, now_ns);
  take(operation_, now_ns);
  return fleet_.look(now_ns);
}

}  // namespace hapticd
