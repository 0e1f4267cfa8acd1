// Counts the heap calls inside the haptic tick, in the program that people run.
//
// The loop marks where its thread is (`region`), and the program's malloc (server/os/malloc_count.cpp) adds
// one to that region's count. Outside a marked region this costs malloc one thread-local load and a branch.
// `haptic` is our own code of the tick; `transport` is what the device port calls in it, mainly DDS.
// `available` is false in a program without that malloc and in every sanitizer build: nothing is counted
// there.
// Thread safety: `region` is each thread's own; the counts are atomic and cover all threads together.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace hapticd::allocation_count {

enum class Region : std::uint8_t { elsewhere, haptic, transport };

inline constinit thread_local Region region = Region::elsewhere;
inline constinit std::array<std::atomic<std::uint64_t>, 3> count{};
inline constinit std::atomic<bool> available{false};

inline void note() noexcept {
  if (region == Region::elsewhere) [[likely]]
    return;
  count[static_cast<std::size_t>(region)].fetch_add(1, std::memory_order_relaxed);
}

inline std::uint64_t in(Region r) noexcept {
  return count[static_cast<std::size_t>(r)].load(std::memory_order_relaxed);
}

// Marks the calling thread while it lives; marks nest.
class Mark {
 public:
  explicit Mark(Region r) noexcept : before_(region) { region = r; }
  ~Mark() { region = before_; }
  Mark(const Mark&) = delete;
  Mark& operator=(const Mark&) = delete;

 private:
  Region before_;
};

}  // namespace hapticd::allocation_count
