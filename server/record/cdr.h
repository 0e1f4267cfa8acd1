// Classic CDR as ROS 2 messages are stored in it: 4 bytes of representation, then each value at a multiple of
// its size, counted from after those four.
//
//   representation 0x0001: little endian (what is written here), 0x0000: big endian
//   string: length with its closing zero (uint32), the bytes, the zero;   sequence: length (uint32), the
//   items
//
// No type of more than 8 bytes, no XCDR2. Errors: the reader throws CdrError where the bytes end early, a
// length is more than what is left, or the representation is another.
// Source: OMG, DDS-XTypes 1.3, 7.4.1; checked against Cyclone's own reader
// (tests/server/record/ros2_messages_test.cpp).
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace hapticd {

static_assert(std::endian::native == std::endian::little);

class CdrError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Grows to its largest message and allocates no more.
class CdrWriter {
 public:
  CdrWriter() { clear(); }

  void clear() { bytes_.assign({0, 1, 0, 0}); }
  template <typename T>
  void put(T value) {
    bytes_.resize(header + (bytes_.size() - header + sizeof(T) - 1) / sizeof(T) * sizeof(T), 0);
    const auto* from = reinterpret_cast<const std::uint8_t*>(&value);
    bytes_.insert(bytes_.end(), from, from + sizeof(T));
  }
  void text(std::string_view s) {
    put(static_cast<std::uint32_t>(s.size() + 1));
    bytes_.insert(bytes_.end(), s.begin(), s.end());
    bytes_.push_back(0);
  }
  std::span<const std::uint8_t> bytes() const { return bytes_; }

 private:
  static constexpr std::size_t header = 4;
  std::vector<std::uint8_t> bytes_;
};

class CdrReader {
 public:
  explicit CdrReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {
    if (bytes.size() < 4) throw CdrError("is no CDR: it has " + std::to_string(bytes.size()) + " bytes");
    if (bytes[0] != 0 || bytes[1] > 1)
      throw CdrError("is in a representation other than plain CDR (0x" + hex(bytes[0]) + hex(bytes[1]) + ")");
    swap_ = bytes[1] == 0;
    bytes_ = bytes.subspan(4);
  }

  template <typename T>
  T get() {
    at_ = (at_ + sizeof(T) - 1) / sizeof(T) * sizeof(T);
    need(sizeof(T));
    std::array<std::uint8_t, sizeof(T)> raw;
    std::memcpy(raw.data(), bytes_.data() + at_, sizeof(T));
    if (swap_) std::reverse(raw.begin(), raw.end());
    at_ += sizeof(T);
    return std::bit_cast<T>(raw);
  }
  std::string text() {
    const auto length = get<std::uint32_t>();  // with the closing zero
    need(length);
    const std::string s(reinterpret_cast<const char*>(bytes_.data() + at_), length > 0 ? length - 1 : 0);
    at_ += length;
    return s;
  }
  // Of a sequence whose items have `least` bytes at least.
  std::uint32_t length(std::size_t least) {
    const auto n = get<std::uint32_t>();
    if (n > (bytes_.size() - at_) / least) throw CdrError("ends within a sequence of " + std::to_string(n));
    return n;
  }

 private:
  void need(std::size_t count) const {
    if (at_ > bytes_.size() || bytes_.size() - at_ < count) throw CdrError("ends early");
  }
  static std::string hex(std::uint8_t byte) {
    constexpr const char* digit = "0123456789abcdef";
    return {digit[byte >> 4], digit[byte & 15]};
  }

  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
  bool swap_ = false;
};

}  // namespace hapticd
