#include "server/dds/rtps_numbers.h"

#include <algorithm>
#include <cstddef>

namespace hapticd {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr std::size_t message_header = 20, submessage_header = 4, prefix_at = 8, prefix_size = 12;
enum : std::uint8_t { pad = 0x01, heartbeat = 0x07, gap = 0x08, info_timestamp = 0x09, info_source = 0x0c };
enum : std::uint8_t { data = 0x15, data_fragment = 0x16 };
constexpr std::uint8_t little_endian = 0x01, builtin = 0xc0;

// A high word that is signed, and a low one.
std::int64_t number_at(Bytes b, bool little) noexcept {
  const auto word = [&](std::size_t at) {
    std::uint64_t n = 0;
    for (std::size_t i = 0; i < 4; ++i) n = n << 8 | b[at + (little ? 3 - i : i)];
    return n;
  };
  return static_cast<std::int64_t>(word(0) << 32 | word(4));
}

}  // namespace

bool RtpsNumbers::follow(const Writer& writer, std::int64_t number, bool is_data,
                         std::int64_t now_ns) noexcept {
  if (number < 1) return true;  // none that a writer gives: Cyclone drops it, and differences would overflow
  std::uint32_t hash = 2166136261u;  // FNV-1a
  for (const std::uint8_t byte : writer) hash = (hash ^ byte) * 16777619u;
  Known& known = known_[hash % known_.size()];
  if (known.busy.test_and_set(std::memory_order_acquire)) return true;
  const bool fresh = known.heard_ns != 0 && now_ns - known.heard_ns < remembered_ns;
  const bool same = known.writer == writer;
  const bool leaps = fresh && same && number > known.highest && number - known.highest > farthest;
  if (is_data && !leaps && (same || !fresh)) {
    known.highest = fresh ? std::max(known.highest, number) : number;
    known.writer = writer;
    known.heard_ns = now_ns;
  }
  known.busy.clear(std::memory_order_release);
  return !leaps;
}

bool RtpsNumbers::take(Bytes message, std::int64_t now_ns) noexcept {
  if (message.size() < message_header) return true;
  Writer writer{};
  std::copy_n(message.begin() + prefix_at, prefix_size, writer.begin());
  for (std::size_t at = message_header; at + submessage_header <= message.size();) {
    const std::uint8_t kind = message[at], flags = message[at + 1];
    const bool little = flags & little_endian;
    std::size_t length =
        little ? message[at + 2] | message[at + 3] << 8 : message[at + 3] | message[at + 2] << 8;
    at += submessage_header;
    if (length == 0 && kind != pad && kind != info_timestamp) length = message.size() - at;
    length = std::min(length, message.size() - at);
    const Bytes body = message.subspan(at, length);
    at += length;
    // Where the writer's name is, and the number from which its reader goes on.
    std::size_t name = 0, number = 0;
    if (kind == info_source && body.size() >= 8 + prefix_size) {
      std::copy_n(body.begin() + 8, prefix_size, writer.begin());
    } else if (kind == data || kind == data_fragment) {
      name = 8;
      number = 12;
    } else if (kind == gap) {
      name = 4;
      number = 16;
    } else if (kind == heartbeat) {
      name = 4;
      number = 8;
    }
    if (name == 0 || body.size() < number + 8 || (body[name + 3] & builtin) != 0) continue;
    std::copy_n(body.begin() + static_cast<std::ptrdiff_t>(name), 4, writer.begin() + prefix_size);
    if (!follow(writer, number_at(body.subspan(number), little), kind == data || kind == data_fragment,
                now_ns))
      return false;
  }
  return true;
}

}  // namespace hapticd
