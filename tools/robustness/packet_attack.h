// A stranger that speaks RTPS by hand: seeded mutations of captured messages, sent to every participant of a
// domain on loopback.
//
// The messages are those of config/dds/packets.hex: discovery, handshakes and data between a daemon and its
// clients. Each stranger announces itself under a GUID of its own, says that its built-in writers have
// samples (without a heartbeat Cyclone keeps none of them), and then sends messages of the file, most of them
// changed in one to eight places, with the sequence numbers that the receiver waits for. After `per_stranger`
// messages the next one comes.
//
// The same seed makes the same messages, except for the GUIDs of those who are attacked.
// Thread safety: one thread. Errors: std::runtime_error where the file is missing or no socket can be had.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <random>
#include <span>
#include <vector>

namespace hapticd {

using Packet = std::vector<std::uint8_t>;
using GuidPrefix = std::array<std::uint8_t, 12>;

// One message a line, in hexadecimal digits; lines that begin with # are skipped.
std::vector<Packet> read_packets(const std::filesystem::path& file);

// Changes one to eight places of a message: bits, bytes, whole words, lengths, parameters, order, end.
void mutate(Packet& packet, std::mt19937_64& random);

struct PacketAttack {
  std::uint32_t domain = 0;
  std::uint64_t seed = 1;
  long packets = 60'000;
  double rate = 10'000;   // [1/s]
  double seconds = 3600;  // ends earlier
  int first_port = 0;     // 0: the ports of `domain`
  bool samples = true;    // also states and forces: these can play a second client or daemon
  bool mutated = true;    // false: as captured
};

struct PacketCount {
  long sent = 0;
  int participants = 0;  // that were found and attacked
};

PacketCount attack_with_packets(const PacketAttack& options);

}  // namespace hapticd
