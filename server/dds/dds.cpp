#include "server/dds/dds.h"

#include <atomic>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "server/dds/dds_sockets.h"
#include "server/dds/network.h"
#include "server/files/paths.h"
#include "server/os/realtime.h"
#include "server/os/room.h"

namespace hapticd {

std::string read_dds_profile(const std::string& name) {
  const std::filesystem::path file = config_file(std::filesystem::path("dds") / (name + ".xml"));
  std::ifstream in(file);
  if (!in) throw std::runtime_error("cannot read the DDS profile " + file.string());
  return {std::istreambuf_iterator<char>(in), {}};
}

std::string default_dds_profile_name() { return realtime_allowed() ? "loopback_realtime" : "loopback"; }
std::string default_dds_profile() {
  const Network& network = process_network();
  return network.interface.empty() ? read_dds_profile(default_dds_profile_name())
                                   : network_profile(network, realtime_allowed());
}

std::string dds_place(std::uint32_t domain, const std::string& profile_name) {
  return "DDS domain " + std::to_string(domain) + " with the profile " +
         config_file(std::filesystem::path("dds") / (profile_name + ".xml")).string();
}

namespace {
std::atomic<bool> network_is_open{false};
// What a domain with its participant takes, and some to spare.
constexpr int cyclone_threads = 10, cyclone_descriptors = 16;
}  // namespace
bool is_network_open() noexcept { return network_is_open.load(std::memory_order_relaxed); }
void open_network() noexcept { network_is_open.store(true, std::memory_order_relaxed); }

dds_entity_t require(dds_entity_t code, const std::string& what) {
  if (code < 0) throw std::runtime_error("DDS: cannot make " + what + ": " + dds_strretcode(-code));
  return code;
}

Domain::Domain(std::uint32_t id, const std::string& xml)
    : id_(id), loopback_alone_(names_loopback_alone(xml)) {
  const std::string what = "domain " + std::to_string(id);
  if (xml.find(">Realtime<") != std::string::npos && !realtime_allowed())
    throw std::runtime_error("DDS: cannot make " + what +
                             ": its profile asks for real-time threads and this "
                             "process has no right to SCHED_FIFO; use the profile loopback");
  // Cyclone crashes where it gets none of these.
  require_threads(cyclone_threads);
  require_descriptors(cyclone_descriptors);
  const LoopbackSockets sockets(loopback_alone_);
  const dds_entity_t made = dds_create_domain(id, xml.c_str());
  if (made == DDS_RETCODE_ERROR)
    throw std::runtime_error(
        "DDS: cannot make " + what +
        ": Cyclone's own words are above. Where it found no free participant index, a hundred "
        "programs use this domain: end some of them (each haptic command is one), or take "
        "another domain with --domain");
  entity_ = DdsEntity(require(made, what));
}

Participant::Participant(const Domain& domain, const std::optional<Security>& security) {
  if (!domain.loopback_alone() && !security && !network_is_open.load(std::memory_order_relaxed))
    throw std::runtime_error(
        "DDS: the profile reaches beyond this machine: whoever is on that network could move the device and "
        "end the "
        "process. Use --secure DIR, or say --open-network if everybody there is trusted");
  const Qos qos(dds_create_qos(), &dds_delete_qos);
  std::string what = "a participant in domain " + std::to_string(domain.id());
  if (security) {
    set_security(*qos, *security);
    what += " as " + security->role + " with " + security->certificate.parent_path().string() +
            " (certificate, signature or validity refused; Cyclone's own words are above)";
  }
  entity_ = DdsEntity(require(dds_create_participant(domain.id(), qos.get(), nullptr), what));
}

Qos realtime_qos(int depth) {
  Qos qos(dds_create_qos(), &dds_delete_qos);
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_BEST_EFFORT, 0);
  dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, depth);
  at_station(*qos);
  return qos;
}

Qos retained_qos() {
  Qos qos(dds_create_qos(), &dds_delete_qos);
  // The wait bounds how long a full writer may hold up the diagnostics thread.
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_durability(qos.get(), DDS_DURABILITY_TRANSIENT_LOCAL);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
  dds_qset_durability_service(qos.get(), 0, DDS_HISTORY_KEEP_LAST, 1, DDS_LENGTH_UNLIMITED,
                              DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  at_station(*qos);
  return qos;
}

// Instances are the devices' ids, which stations share: hence the depth.
Qos onlooker_qos() {
  constexpr int depth = 512;
  Qos qos(dds_create_qos(), &dds_delete_qos);
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_BEST_EFFORT, 0);
  dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, depth);
  if (process_network().station.empty()) {
    const char* stations[] = {"", "*"};
    dds_qset_partition(qos.get(), 2, stations);
  } else {
    at_station(*qos);
  }
  return qos;
}

}  // namespace hapticd
