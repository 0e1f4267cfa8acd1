#include "server/dds/force_reader.h"

#include <chrono>

namespace hapticd {
namespace {

using Traits = TopicTraits<hapticd_msg_ForceCommand>;

constexpr auto relaxed = std::memory_order_relaxed;
constexpr std::int64_t silence_ns = 100'000'000;

std::int64_t now_ns() noexcept {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

dds_topic_filter force_filter(dds_topic_filter_sample_sampleinfo_arg_fn f, void* self) noexcept {
  dds_topic_filter filter{};
  filter.mode = DDS_TOPIC_FILTER_SAMPLE_SAMPLEINFO_ARG;
  filter.f.sample_sampleinfo_arg = f;
  filter.arg = self;
  return filter;
}

Qos reader_qos(ForceReader::Side side) {
  Qos qos = side == ForceReader::Side::client ? realtime_qos(forces_kept) : Traits::reader_qos();
  // One participant has the stations of all devices of a daemon.
  if (side == ForceReader::Side::daemon) dds_qset_ignorelocal(qos.get(), DDS_IGNORELOCAL_PARTICIPANT);
  return qos;
}

}  // namespace

ForceReader::ForceReader(const Participant& participant, std::uint32_t device_id, Side side)
    : device_id_(device_id),
      side_(side),
      topic_(Reader<hapticd_msg_ForceCommand>::filtered(
          make_topic<hapticd_msg_ForceCommand>(participant),
          force_filter(
              [](const void* sample, const dds_sample_info_t* info, void* self) {
                return static_cast<ForceReader*>(self)->wanted(
                    *static_cast<const hapticd_msg_ForceCommand*>(sample), info->publication_handle);
              },
              this))),
      entity_(
          require(dds_create_reader(participant.handle(), topic_.handle(), reader_qos(side).get(), nullptr),
                  std::string("reader of ") + Traits::name +
                      (side == Side::daemon ? " (keys of an older version? run make_keys.sh again)" : ""))) {}

// Cyclone's receive thread.
bool ForceReader::wanted(const hapticd_msg_ForceCommand& force, dds_instance_handle_t writer) noexcept {
  if (force.device_id != device_id_) return false;
  const std::int64_t now = now_ns();
  if (side_ == Side::client) {
    const dds_instance_handle_t daemon = daemon_.load(relaxed);
    if (daemon == 0 || now - heard_ns_.load(relaxed) >= silence_ns) daemon_.store(writer, relaxed);
    if (writer == daemon_.load(relaxed)) {
      heard_ns_.store(now, relaxed);
      return true;
    }
  }
  stranger_ns_.store(now, relaxed);
  strange_.fetch_add(1, relaxed);
  return false;
}

bool ForceReader::stranger(std::int64_t now) const noexcept {
  const std::int64_t came = stranger_ns_.load(relaxed);
  return came != 0 && now - came < stranger_stays_ns;
}

int ForceReader::matched() const noexcept {
  dds_subscription_matched_status_t s{};
  const dds_return_t code = dds_get_subscription_matched_status(entity_.handle(), &s);
  return code == DDS_RETCODE_OK ? static_cast<int>(s.current_count) : 0;
}

}  // namespace hapticd
