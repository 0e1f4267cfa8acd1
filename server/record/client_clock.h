// A client's stamps on this machine's clock, so that how late a state arrives bends no motion.
//
//   t = t_client + offset,   offset = arrival − t_client of the first state, kept
//
// The offset is found anew where the clock must be another: the number or the client's time does not rise (a
// client that started again), or t is more than a second off the arrival (a clock that was set). A client
// without a clock (its time stands still) is thereby stamped on arrival. Results rise strictly. Units: ns.
// Guarantee: wait-free, no allocation.
#pragma once

#include <algorithm>
#include <cstdint>

namespace hapticd {

class ClientClock {
 public:
  std::int64_t stamp(std::uint64_t number, std::int64_t client_ns, std::int64_t arrived_ns) noexcept {
    constexpr std::int64_t most_off = 1'000'000'000;
    const bool same = known_ && number > number_ && client_ns > client_ns_;
    // Unsigned, as a client's time may be anything.
    const auto mapped = static_cast<std::int64_t>(static_cast<std::uint64_t>(client_ns) + offset_);
    const bool kept = same && mapped >= arrived_ns - most_off && mapped <= arrived_ns + most_off;
    if (!kept) offset_ = static_cast<std::uint64_t>(arrived_ns) - static_cast<std::uint64_t>(client_ns);
    const std::int64_t found = kept ? mapped : arrived_ns;
    stamp_ = known_ ? std::max(found, stamp_ + 1) : found;
    known_ = true;
    number_ = number;
    client_ns_ = client_ns;
    return stamp_;
  }

 private:
  bool known_ = false;
  std::uint64_t number_ = 0, offset_ = 0;
  std::int64_t client_ns_ = 0, stamp_ = 0;
};

}  // namespace hapticd
