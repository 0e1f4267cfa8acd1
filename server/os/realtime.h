// What the operating system can be asked for so that 1 kHz holds, and what it answered.
//
// Every function reports a refusal as a value and leaves the process in working order: without
// privileges the daemon runs, later wake-ups are its only loss. `detail` names the way out.
// Thread safety: the process-wide ones belong to start-up; the others act on the calling thread.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace hapticd {

struct Grant {
  std::string what;  // "SCHED_FIFO 80", "mlockall", …
  bool granted = false;
  std::string detail;  // why not, and what would help; empty when granted
};

// The haptic loop's priority, the highest that the daemon uses.
inline constexpr int haptic_priority = 80;

// Of every other thread that calls Cyclone, as of Cyclone's own that are not in a sample's way (config/dds).
// All of them share locks with the haptic loop, which inherit no priority: an ordinary thread that is put
// aside while it holds one stops the loop for as long as the machine is busy.
inline constexpr int dds_priority = 45;

// The simulation's: it goes before ordinary programs on its core, its own maker of reference factors among
// them. That maker is an ordinary program: after them it would be late whenever they keep the cores busy, and
// each step then pays for what its factor does not cover.
inline constexpr int simulation_nice = -10;

// What is far from regions that an instrument may come to: after all that a step waits for.
inline constexpr int far_tissue_nice = 5;

// Whether this process may use SCHED_FIFO up to that priority, tried on a thread that ends at once.
bool realtime_allowed(int priority = haptic_priority);

// Process-wide: malloc keeps its pages (M_MMAP_THRESHOLD, M_TRIM_THRESHOLD 1 GiB: page faults cost a
// third of a factorisation); mlockall of present and future pages.
Grant keep_malloc_pages();
Grant lock_memory();

// Keeps /dev/cpu_dma_latency open with 0 µs while it lives: no deep idle states.
class CpuLatency {
 public:
  CpuLatency();
  ~CpuLatency();
  CpuLatency(const CpuLatency&) = delete;
  CpuLatency& operator=(const CpuLatency&) = delete;
  const Grant& grant() const noexcept { return grant_; }

 private:
  int file_ = -1;
  Grant grant_;
};

// The cores that this process may use, in rising order; never empty.
std::vector<int> process_cores();

// Calling thread.
void name_thread(const char* name) noexcept;  // as ps and top show it; 15 characters
Grant use_fifo(int priority);
Grant use_nice(int nice);
Grant use_core(int core);
// Calling thread and those it makes: any of its cores but this one, where there is another.
void leave_core(int core) noexcept;
// Calling thread and those it makes, of a program that only looks on: after ordinary programs (nice 10), and
// off the core that a daemon with the same cores gives to its haptic thread, the last one, where there is
// another.
void stand_back() noexcept;
// Touches 512 KiB of stack below the caller, so that no later call faults there.
void prefault_stack() noexcept;
// Gives the calling thread's part of malloc (its arena) that much at once, touched. It stays where
// `keep_malloc_pages` was granted, so that what the thread asks for later comes from pages that are there.
void prefault_heap(std::size_t bytes) noexcept;
// For the haptic thread, and for whoever hands samples to Cyclone: its pool is one for all threads, and a
// buffer from it is lengthened in the arena that it came from, by whoever writes. An arena that has no room
// left there would grow by a page, with a system call, in the haptic thread.
inline constexpr std::size_t sample_heap = 1 << 20;  // [bytes]

// Calling thread confined to one core while it lives; threads made meanwhile inherit that.
class ScopedCore {
 public:
  explicit ScopedCore(int core);
  ~ScopedCore();
  ScopedCore(const ScopedCore&) = delete;
  ScopedCore& operator=(const ScopedCore&) = delete;
  const Grant& grant() const noexcept { return grant_; }

 private:
  std::vector<int> before_;
  Grant grant_;
};

}  // namespace hapticd
