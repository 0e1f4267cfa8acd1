// What a hostile or broken client does to a daemon, for a bounded time, on loopback.
//
// An attack runs in a process of its own (`haptic abuse --attack NAME`), so that it costs the well-behaved
// client nothing but what it costs the machine. Device 0 is the well-behaved client's, device 1 the
// attackers' own.
//   lies        device 1: NaN and infinite poses, zero quaternions, between valid states that arm
//   backwards   device 1: numbers going back
//   flood       devices 0 and 1: 10 000 states a second
//   crowd       200 clients for device 0, twenty at a time, each sending a few states
//   doubles     a second writer for device 0 with another pose
//   types       other types on the state's topic, under their own and under the state's type name
//   dying       device 1: touches, then ends without a word; again and again
//   packets     RTPS messages changed at random, to every participant of the domain (packet_attack.h)
// Errors: std::invalid_argument for an unknown name; std::runtime_error from DDS.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace hapticd {

const std::vector<std::string>& attacks();

// Returns when the time is over.
void attack(const std::string& name, double seconds, std::uint32_t domain);

}  // namespace hapticd
