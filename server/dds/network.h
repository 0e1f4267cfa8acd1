// Where a process meets others: which network, and at which station of it.
//
//   interface   none: this machine alone (loopback profiles); else config/dds/network.xml or
//               network_realtime.xml, with interface, peers and multicast filled in
//   peers       addresses that are asked, besides this machine; none: whoever hears the multicast
//   station     a DDS partition: two stations do not hear one another; none: the one without a name
//
// An interface reaches beyond this machine: participants then need keys, or open_network() (dds.h).
// Thread safety: use_network belongs to the start, before any entity is made. Errors: network_profile throws
// std::runtime_error where a file is missing or is no template.
#pragma once

#include <dds/dds.h>

#include <string>
#include <vector>

namespace hapticd {

struct Network {
  std::string interface;           // a name as `ip link` has it, or its IPv4 address
  std::vector<std::string> peers;  // host names or addresses
  std::string station;
};

// What is wrong with a name of any of these, which a profile and a partition must hold; "": nothing.
std::string network_name_fault(const std::string& name);

// Of this process, from now on. Pre: names without fault.
void use_network(const Network& network);
const Network& process_network() noexcept;

// The profile's text for a network with an interface, with real-time threads or without.
std::string network_profile(const Network& network, bool realtime);
// For a program that only looks on: the process's network, or loopback; without real-time threads.
std::string viewer_dds_profile();

// Puts what is made with these QoS at this process's station, or at this thread's StationHere.
void at_station(dds_qos_t& qos) noexcept;

// While it lives, what this thread makes is at that station; an empty name leaves the process's. For a
// library whose handles may be at several. Objects of one thread end in the reverse order of their begin.
class StationHere {
 public:
  explicit StationHere(const std::string& station);
  ~StationHere();
  StationHere(const StationHere&) = delete;
  StationHere& operator=(const StationHere&) = delete;

 private:
  const std::string station_;
  const std::string* before_;
};

}  // namespace hapticd
