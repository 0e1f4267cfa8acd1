// Whether an RTPS message keeps to its writers' numbers: one far ahead would make Cyclone refuse all that
// follow.
//
// A reader of the newest value takes rising numbers alone. Without DDS Security anybody on the network can
// send one message in a client's name with a number far ahead; of the client itself nothing would be heard
// again until it makes another writer. So of each writer of the last second the highest number is known, and
// a message that leaps by more than `farthest` beyond it is refused: at 1 kHz a gap of that many takes longer
// than that second. What is below that leap costs the client as many states, and with keys nobody else can
// send it (submessages are encrypted). After a second without a message any number is taken. Discovery's own
// writers are not looked at.
//
// Thread safety: any thread. Guarantee: wait-free, no allocation; a writer whose place another thread holds
// at this instant, or another writer has, is not looked at.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <span>

namespace hapticd {

class RtpsNumbers {
 public:
  static constexpr std::int64_t farthest = 2000, remembered_ns = 1'000'000'000;

  // message: one that rtps_is_safe. False: it is not to be given to Cyclone.
  bool take(std::span<const std::uint8_t> message, std::int64_t now_ns) noexcept;

 private:
  using Writer = std::array<std::uint8_t, 16>;
  struct Known {
    std::atomic_flag busy = ATOMIC_FLAG_INIT;
    Writer writer{};
    std::int64_t highest = 0, heard_ns = 0;
  };
  bool follow(const Writer& writer, std::int64_t number, bool data, std::int64_t now_ns) noexcept;

  std::array<Known, 256> known_;
};

}  // namespace hapticd
