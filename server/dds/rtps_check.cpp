#include "server/dds/rtps_check.h"

#include <cstddef>
#include <cstring>

namespace hapticd {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr std::size_t message_header = 20, submessage_header = 4;
enum : std::uint8_t { pad = 0x01, info_timestamp = 0x09, data = 0x15, data_fragment = 0x16 };
enum : std::uint8_t { little_endian = 0x01, has_inline_qos = 0x02, has_data = 0x04, has_key = 0x08 };
enum : std::uint16_t { pid_sentinel = 0x01, pid_type_information = 0x75, must_understand = 0x4000 };

// Reads forward; what is not there fails, and stays failed.
class Cursor {
 public:
  Cursor(Bytes bytes, bool little) noexcept : bytes_(bytes), little_(little) {}
  std::size_t left() const noexcept { return bytes_.size() - at_; }
  bool ok() const noexcept { return ok_; }

  Bytes take(std::size_t n) noexcept {
    if (!ok_ || n > left()) {
      ok_ = false;
      return {};
    }
    at_ += n;
    return bytes_.subspan(at_ - n, n);
  }
  std::uint8_t byte() noexcept {
    const Bytes b = take(1);
    return ok_ ? b[0] : std::uint8_t{0};
  }
  std::uint32_t number(std::size_t size) noexcept {
    const Bytes b = take(size);
    std::uint32_t n = 0;
    for (std::size_t i = 0; i < b.size(); ++i) n = n << 8 | b[little_ ? b.size() - 1 - i : i];
    return n;
  }
  std::uint16_t half() noexcept { return static_cast<std::uint16_t>(number(2)); }
  std::uint32_t word() noexcept { return number(4); }
  // The next `n` bytes by themselves.
  Cursor part(std::size_t n) noexcept {
    Cursor inside(take(n), little_);
    inside.ok_ = ok_;
    return inside;
  }
  // XCDR2: a size, and what has this size.
  Cursor delimited() noexcept { return part(word()); }
  // At the end, but for the padding of what comes after.
  bool done() const noexcept { return ok_ && left() < 4; }

 private:
  Bytes bytes_;
  std::size_t at_ = 0;
  bool little_, ok_ = true;
};

// TypeIdentifierWithTypeObjectSize: a hash of this kind, and the size of what it stands for.
bool hash_with_size(Cursor c, std::uint8_t kind) noexcept {
  constexpr std::size_t hash = 14, padding = 1;
  const bool right_kind = c.byte() == kind;
  c.take(hash + padding);
  const bool has_size = c.word() != 0;
  return right_kind && has_size && c.done();
}

// TypeIdentifierWithDependencies.
bool type_with_dependencies(Cursor c, std::uint8_t kind) noexcept {
  if (!hash_with_size(c.delimited(), kind)) return false;
  const auto count = static_cast<std::int32_t>(c.word());
  Cursor list = c.delimited();
  const std::uint32_t length = list.word();
  if (!c.done() || !list.ok()) return false;
  if (count < -1 || static_cast<std::int64_t>(length) > (count < 0 ? 0 : count)) return false;
  for (std::uint32_t i = 0; i < length; ++i)
    if (!hash_with_size(list.delimited(), kind)) return false;
  return list.done();
}

bool type_information(Cursor c) noexcept {
  constexpr std::uint32_t minimal = 0x1001, complete = 0x1002;
  constexpr std::uint8_t hash_of_minimal = 0xf1, hash_of_complete = 0xf2;
  bool has_minimal = false, has_complete = false;
  Cursor members = c.delimited();
  if (!c.done()) return false;
  while (members.ok() && members.left() >= 4) {
    const std::uint32_t header = members.word(), id = header & 0x0fffffff, length_code = header >> 28 & 7;
    // With code 4 the value's size comes before it; with 5 that is the value's own first word.
    if (length_code != 4 && length_code != 5) return false;
    Cursor value = length_code == 4 ? members.delimited().delimited() : members.delimited();
    bool& had = id == minimal ? has_minimal : has_complete;
    if ((id != minimal && id != complete) || had) return false;
    if (!type_with_dependencies(value, id == minimal ? hash_of_minimal : hash_of_complete)) return false;
    had = true;
  }
  return members.done() && has_minimal && has_complete;
}

bool parameter_list(Cursor& c) noexcept {
  while (true) {
    const std::uint16_t id = c.half(), length = c.half();
    if (!c.ok()) return false;
    if (id == pid_sentinel) return true;
    if (length % 4 != 0) return false;
    Cursor value = c.part(length);
    if (!value.ok()) return false;
    if ((id & ~must_understand) == pid_type_information && !type_information(value)) return false;
  }
}

// Writers are named in big-endian order whatever the message is in.
std::uint32_t entity(Cursor& c) noexcept {
  const Bytes b = c.take(4);
  return c.ok() ? std::uint32_t{b[0]} << 24 | std::uint32_t{b[1]} << 16 | std::uint32_t{b[2]} << 8 | b[3] : 0;
}

bool exchanges_types(std::uint32_t writer) noexcept { return writer == 0x000300c3 || writer == 0x000301c3; }

// Participants, topics, writers and readers; with DDS Security too.
bool discovers(std::uint32_t writer) noexcept {
  constexpr std::uint32_t writers[] = {0x000100c2, 0x000002c2, 0x000003c2, 0x000004c2,
                                       0xff0003c2, 0xff0004c2, 0xff0101c2};
  for (const std::uint32_t w : writers)
    if (w == writer) return true;
  return false;
}

bool sample(Bytes bytes, std::uint8_t kind, std::uint8_t flags) noexcept {
  const bool little = flags & little_endian;
  Cursor c(bytes, little);
  c.half();  // extra flags
  const std::size_t before_inline_qos = c.half();
  Cursor header = c;
  entity(header);  // the reader
  const std::uint32_t writer = entity(header);
  if (!header.ok()) return false;
  if (exchanges_types(writer)) return false;
  if (kind == data_fragment) return !discovers(writer);
  c.take(before_inline_qos);
  if (!c.ok()) return false;
  if (flags & has_inline_qos && !parameter_list(c)) return false;
  if (!(flags & (has_data | has_key))) return true;
  const Bytes encoding = c.take(4);
  if (!c.ok()) return false;
  const bool is_list = encoding[0] == 0 && (encoding[1] == 2 || encoding[1] == 3);
  if (!is_list) return true;
  Cursor list(c.take(c.left()), encoding[1] == 3);
  return parameter_list(list);
}

}  // namespace

bool rtps_is_safe(Bytes message) noexcept {
  if (message.size() < message_header || std::memcmp(message.data(), "RTPS", 4) != 0) return false;
  for (std::size_t at = message_header; at < message.size();) {
    if (message.size() - at < submessage_header) return false;
    const std::uint8_t kind = message[at], flags = message[at + 1];
    const std::size_t first = message[at + 2], second = message[at + 3];
    std::size_t length = flags & little_endian ? first | second << 8 : second | first << 8;
    at += submessage_header;
    // Zero says "to the end", but for the two that may be empty.
    if (length == 0 && kind != pad && kind != info_timestamp) length = message.size() - at;
    if (length > message.size() - at) return false;
    if ((kind == data || kind == data_fragment) && !sample(message.subspan(at, length), kind, flags))
      return false;
    at += length;
  }
  return true;
}

}  // namespace hapticd
