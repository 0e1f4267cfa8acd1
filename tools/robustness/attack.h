// What a hostile or broken client does to a daemon, for a bounded time, on loopback.
//
// An attack runs in a process of its own (`haptic abuse --attack NAME`), so that it costs the well-behaved
// client nothing but what it costs the machine. One device is the well-behaved client's, one the attackers'
// own.
//   lies        their own: NaN and infinite poses, zero quaternions, between valid states that arm
//   backwards   their own: numbers going back
//   flood       both: 10 000 states a second
//   crowd       200 clients for the well-behaved client's, twenty at a time, each sending a few states
//   doubles     a second writer for the well-behaved client's with another pose
//   types       other types on the state's topic, under their own and under the state's type name
//   dying       their own: touches, then ends without a word; again and again
//   packets     RTPS messages changed at random, to every participant of the domain (packet_attack.h)
// Errors: std::invalid_argument for an unknown name; std::runtime_error from DDS.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace hapticd {

const std::vector<std::string>& attacks();

struct AttackTarget {
  std::uint32_t domain = 0;
  std::uint32_t behaving = 0, own = 1;  // devices
};

// Returns when the time is over.
void attack(const std::string& name, double seconds, const AttackTarget& target);

}  // namespace hapticd
