#include "server/dds/network.h"

#include <algorithm>
#include <cctype>
#include <stdexcept>

#include "server/dds/dds.h"

namespace hapticd {
namespace {

Network& of_process() noexcept {
  static Network network;
  return network;
}

thread_local const std::string* station_here = nullptr;

void replace(std::string& text, const std::string& what, const std::string& with) {
  const std::size_t at = text.find(what);
  if (at == std::string::npos) throw std::runtime_error("the DDS profile for networks has no " + what);
  text.replace(at, what.size(), with);
}

bool is_address(const std::string& name) {
  return name.find('.') != std::string::npos && name.find_first_not_of("0123456789.") == std::string::npos;
}

}  // namespace

// DDS takes * and ? in a partition for patterns; the rest would be XML's.
std::string network_name_fault(const std::string& name) {
  const bool plain = std::all_of(name.begin(), name.end(), [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) || std::string("._-:@").find(c) != std::string::npos;
  });
  return plain && !name.empty() ? "" : "'" + name + "' is no name: letters, digits and . _ - : @ alone";
}

void use_network(const Network& network) { of_process() = network; }

const Network& process_network() noexcept { return of_process(); }

std::string viewer_dds_profile() {
  const Network& network = process_network();
  return network.interface.empty() ? read_dds_profile("loopback") : network_profile(network, false);
}

std::string network_profile(const Network& network, bool realtime) {
  std::string text = read_dds_profile(realtime ? "network_realtime" : "network");
  replace(text, "@INTERFACE@",
          (is_address(network.interface) ? "address=\"" : "name=\"") + network.interface + "\"");
  std::string discovery;
  if (!network.peers.empty()) {
    discovery = "<Peers><Peer Address=\"localhost\"/>";
    for (const std::string& peer : network.peers) discovery += "<Peer Address=\"" + peer + "\"/>";
    discovery += "</Peers>";
  }
  replace(text, "@DISCOVERY@", discovery);
  replace(text, "@MULTICAST@", network.peers.empty() ? "spdp" : "false");
  return text;
}

void at_station(dds_qos_t& qos) noexcept {
  const std::string& station = station_here ? *station_here : of_process().station;
  if (!station.empty()) dds_qset_partition1(&qos, station.c_str());
}

StationHere::StationHere(const std::string& station) : station_(station), before_(station_here) {
  if (!station_.empty()) station_here = &station_;
}

StationHere::~StationHere() { station_here = before_; }

}  // namespace hapticd
