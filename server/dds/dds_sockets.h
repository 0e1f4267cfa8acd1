// Filters what Cyclone DDS may hear: its calls of bind and recvmsg pass through this file to the C library.
//
// A program that links this file defines both functions, so the loader gives libddsc these instead of libc's;
// a shared library that hides them puts them into libddsc's table of calls (call_table.h), or refuses.
// - Cyclone binds its UDP sockets to every address of the machine, whichever interface its profile names.
//   Where the profile names loopback alone, they are bound to 127.0.0.1, and the kernel drops packets from
//   outside.
// - A received RTPS message that would end the process (rtps_check.h), or make Cyclone deaf to a writer
//   (rtps_numbers.h), is replaced by one without content.
// Other calls pass unchanged: bind outside of LoopbackSockets, and messages that do not begin with "RTPS".
//
// Thread safety: any thread. Guarantee: receiving allocates nothing.
#pragma once

#include <cstdint>
#include <string>

namespace hapticd {

// Whether a profile names interfaces, and each of them is loopback.
bool names_loopback_alone(const std::string& profile_xml);

// While it lives, this thread's UDP sockets for every address of the machine become sockets of loopback.
class LoopbackSockets {
 public:
  explicit LoopbackSockets(bool wanted);
  ~LoopbackSockets();
  LoopbackSockets(const LoopbackSockets&) = delete;
  LoopbackSockets& operator=(const LoopbackSockets&) = delete;
};

// RTPS messages that were not given to Cyclone, since the start.
std::uint64_t packets_refused() noexcept;

}  // namespace hapticd
