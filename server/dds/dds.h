// Cyclone DDS for this project: domain, participant, reader and writer as owners, and the QoS of each topic.
//
//   haptic/device/state, /force                      best effort, volatile, writer keep last 1
//   haptic/server/status, /health                    reliable, transient-local, keep last 1
//   haptic/scene/geometry, /update, /instrument, /operation   reliable, transient-local, keep last 1
//
// No topic has a latency budget, because any above zero loses most 1 kHz samples. State has *shared*
// ownership and a reader depth of 8; the daemon itself keeps to the first client, by a filter
// (device_bridge.h). Exclusive ownership cannot do that: between writers of equal strength Cyclone gives the
// instance to the lower GUID, so a second client can silence the first, and the conflict cannot be reported.
// Thread safety: Cyclone's entities may be used from any thread; a Reader or Writer here is used by one at a
// time. Errors: constructors throw std::runtime_error with Cyclone's reason; take and write are noexcept and
// return Cyclone's code (negative: error).
#pragma once

#include <dds/dds.h>
#include "idl/device.h"  // generated from idl/device.idl
#include "idl/scene.h"   // generated from idl/scene.idl

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "server/dds/dds_security.h"

namespace hapticd {

// Text of config/dds/<name>.xml. Throws std::runtime_error naming the file.
std::string read_dds_profile(const std::string& name);

// The profile that this process may use: loopback_realtime with the right to SCHED_FIFO, else loopback.
std::string default_dds_profile();
std::string default_dds_profile_name();

// Domain and profile, for a message that nobody answered:
// "DDS domain 7 with the profile /usr/share/hapticd/dds/loopback.xml".
std::string dds_place(std::uint32_t domain, const std::string& profile_name);

// Allows from now on a profile that reaches beyond this machine without security (--open-network).
void open_network() noexcept;
bool is_network_open() noexcept;

// Throws std::runtime_error("<what>: <reason>") for a negative code, else returns it.
dds_entity_t require(dds_entity_t code, const std::string& what);

// Owner of one entity, deleted with everything made from it.
class DdsEntity {
 public:
  DdsEntity() = default;
  explicit DdsEntity(dds_entity_t handle) : handle_(handle) {}
  DdsEntity(DdsEntity&& other) noexcept : handle_(std::exchange(other.handle_, 0)) {}
  DdsEntity& operator=(DdsEntity&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~DdsEntity() {
    if (handle_ > 0) dds_delete(handle_);
  }
  dds_entity_t handle() const noexcept { return handle_; }

 private:
  dds_entity_t handle_ = 0;
};

// A domain with an explicit configuration (the XML text itself); CYCLONEDDS_URI is not consulted.
// Throws as well where the XML asks for Realtime threads and the process may not have them: Cyclone
// 0.10 would abort the process.
// A profile that names loopback alone gets sockets of loopback alone (dds_sockets.h).
// Its threads take affinity and, where the profile is silent, policy from the thread that makes it:
// make it before any thread goes SCHED_FIFO.
class Domain {
 public:
  Domain(std::uint32_t id, const std::string& xml);
  std::uint32_t id() const noexcept { return id_; }
  bool loopback_alone() const noexcept { return loopback_alone_; }

 private:
  std::uint32_t id_;
  bool loopback_alone_;
  DdsEntity entity_;
};

class Participant {
 public:
  // Without security it hears and is heard by every participant that has none either. Throws where the domain
  // reaches beyond this machine and neither security nor open_network() was asked for.
  explicit Participant(const Domain& domain, const std::optional<Security>& security = {});
  dds_entity_t handle() const noexcept { return entity_.handle(); }

 private:
  DdsEntity entity_;
};

using Qos = std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)>;

Qos realtime_qos(int depth);  // best effort, volatile, keep last `depth`
Qos retained_qos();           // reliable, transient-local, keep last 1
// Of readers that look on from afar: at all stations, or at this process's if it has one (network.h). Best
// effort and volatile: no writer waits for them, answers them or keeps anything for them.
Qos onlooker_qos();

inline constexpr int state_reader_depth = 8;

// Per type: descriptor, topic name, QoS.
template <typename T>
struct TopicTraits;
template <>
struct TopicTraits<hapticd_msg_DeviceState> {
  static constexpr const char* name = "haptic/device/state";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_DeviceState_desc; }
  static Qos reader_qos() { return realtime_qos(state_reader_depth); }
  static Qos writer_qos() { return realtime_qos(1); }
};
template <>
struct TopicTraits<hapticd_msg_ForceCommand> {
  static constexpr const char* name = "haptic/device/force";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_ForceCommand_desc; }
  static Qos reader_qos() { return realtime_qos(1); }
  static Qos writer_qos() { return realtime_qos(1); }
};
template <>
struct TopicTraits<hapticd_msg_ServerStatus> {
  static constexpr const char* name = "haptic/server/status";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_ServerStatus_desc; }
  static Qos reader_qos() { return retained_qos(); }
  static Qos writer_qos() { return retained_qos(); }
};
template <>
struct TopicTraits<hapticd_msg_SceneGeometry> {
  static constexpr const char* name = "haptic/scene/geometry";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_SceneGeometry_desc; }
  static Qos reader_qos() { return retained_qos(); }
  static Qos writer_qos() { return retained_qos(); }
};
template <>
struct TopicTraits<hapticd_msg_SceneUpdate> {
  static constexpr const char* name = "haptic/scene/update";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_SceneUpdate_desc; }
  static Qos reader_qos() { return retained_qos(); }
  static Qos writer_qos() { return retained_qos(); }
};
template <>
struct TopicTraits<hapticd_msg_SceneInstrument> {
  static constexpr const char* name = "haptic/scene/instrument";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_SceneInstrument_desc; }
  static Qos reader_qos() { return retained_qos(); }
  static Qos writer_qos() { return retained_qos(); }
};
template <>
struct TopicTraits<hapticd_msg_ServerHealth> {
  static constexpr const char* name = "haptic/server/health";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_ServerHealth_desc; }
  static Qos reader_qos() { return retained_qos(); }
  static Qos writer_qos() { return retained_qos(); }
};

template <>
struct TopicTraits<hapticd_msg_SceneOperation> {
  static constexpr const char* name = "haptic/scene/operation";
  static const dds_topic_descriptor_t& descriptor() noexcept { return hapticd_msg_SceneOperation_desc; }
  static Qos reader_qos() { return retained_qos(); }
  static Qos writer_qos() { return retained_qos(); }
};

template <typename T>
DdsEntity make_topic(const Participant& participant) {
  using Traits = TopicTraits<T>;
  return DdsEntity(
      require(dds_create_topic(participant.handle(), &Traits::descriptor(), Traits::name, nullptr, nullptr),
              std::string("topic ") + Traits::name));
}

template <typename T>
class Writer {
 public:
  explicit Writer(const Participant& participant)
      : topic_(make_topic<T>(participant)),
        entity_(require(dds_create_writer(participant.handle(), topic_.handle(),
                                          TopicTraits<T>::writer_qos().get(), nullptr),
                        std::string("writer of ") + TopicTraits<T>::name)) {}

  // Allocation-free once the writer is warm (Cyclone keeps its buffers) for fixed-size types.
  dds_return_t write(const T& sample) noexcept { return dds_write(entity_.handle(), &sample); }
  dds_return_t dispose(const T& key) noexcept { return dds_dispose(entity_.handle(), &key); }
  // How many readers listen.
  int matched() const noexcept {
    dds_publication_matched_status_t s{};
    const dds_return_t code = dds_get_publication_matched_status(entity_.handle(), &s);
    return code == DDS_RETCODE_OK ? static_cast<int>(s.current_count) : 0;
  }
  dds_entity_t handle() const noexcept { return entity_.handle(); }

 private:
  DdsEntity topic_;
  DdsEntity entity_;
};

template <typename T>
class Reader {
 public:
  explicit Reader(const Participant& participant) : Reader(participant, dds_topic_filter{}) {}
  Reader(const Participant& participant, const Qos& qos)
      : topic_(make_topic<T>(participant)),
        entity_(require(dds_create_reader(participant.handle(), topic_.handle(), qos.get(), nullptr),
                        std::string("reader of ") + TopicTraits<T>::name)) {}
  // With a filter, which Cyclone's receive thread asks before it keeps a sample.
  Reader(const Participant& participant, const dds_topic_filter& filter)
      : topic_(filtered(make_topic<T>(participant), filter)),
        entity_(require(dds_create_reader(participant.handle(), topic_.handle(),
                                          TopicTraits<T>::reader_qos().get(), nullptr),
                        std::string("reader of ") + TopicTraits<T>::name)) {}

  // Takes up to N samples into the caller's memory; returns their number. For fixed-size types.
  // Guarantee: allocates nothing after the first samples.
  template <std::size_t N>
  int take_into(std::array<T, N>& samples, std::array<dds_sample_info_t, N>& infos) noexcept {
    std::array<void*, N> buffer;
    for (std::size_t i = 0; i < N; ++i) buffer[i] = &samples[i];
    return dds_take(entity_.handle(), buffer.data(), infos.data(), N, N);
  }

  // Calls f(const T&, const dds_sample_info_t&) for each sample taken, valid data only, on loan.
  // Returns how many were taken in all, or Cyclone's error code.
  template <typename F>
  int take_each(F&& f) {
    constexpr std::size_t batch = 32;
    std::array<void*, batch> buffer{};
    std::array<dds_sample_info_t, batch> infos;
    const int n = dds_take(entity_.handle(), buffer.data(), infos.data(), batch, batch);
    if (n <= 0) return n;
    const auto loan = [this, n](void** b) { dds_return_loan(entity_.handle(), b, n); };
    const std::unique_ptr<void*, decltype(loan)> returned(buffer.data(), loan);
    for (int i = 0; i < n; ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (infos[k].valid_data) f(*static_cast<const T*>(buffer[k]), infos[k]);
    }
    return n;
  }

  static DdsEntity filtered(DdsEntity topic, const dds_topic_filter& filter) {
    if (filter.mode != DDS_TOPIC_FILTER_NONE)
      require(dds_set_topic_filter_extended(topic.handle(), &filter),
              std::string("filter on ") + TopicTraits<T>::name);
    return topic;
  }

  // How many writers there are.
  int matched() const noexcept {
    dds_subscription_matched_status_t s{};
    const dds_return_t code = dds_get_subscription_matched_status(entity_.handle(), &s);
    return code == DDS_RETCODE_OK ? static_cast<int>(s.current_count) : 0;
  }
  dds_entity_t handle() const noexcept { return entity_.handle(); }

 private:
  DdsEntity topic_;
  DdsEntity entity_;
};

}  // namespace hapticd
