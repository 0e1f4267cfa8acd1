#include "server/observe/bag_recorder.h"

#include <chrono>
#include <string>

#include "server/observe/log.h"
#include "server/os/realtime.h"

namespace hapticd {
namespace {

constexpr std::size_t tick_capacity = 16384, diagnostic_capacity = 256;
constexpr auto relaxed = std::memory_order_relaxed;
constexpr auto turn = std::chrono::milliseconds(20);
constexpr int turns_per_commit = 50;

}  // namespace

BagRecorder::BagRecorder(const std::filesystem::path& directory, std::uint32_t device_id)
    : bag_(directory, device_id, realtime_offset_ns()),
      ticks_(tick_capacity),
      diagnostics_(diagnostic_capacity),
      thread_([this] {
        name_thread("recorder");
        run();
      }) {}

BagRecorder::~BagRecorder() { stop(); }

void BagRecorder::stop() noexcept {
  stopping_.store(true, relaxed);
  if (thread_.joinable()) thread_.join();
}

void BagRecorder::run() noexcept {
  for (std::uint64_t n = 1; !stopping_.load(relaxed); ++n) {
    drain();
    if (n % turns_per_commit == 0) bag_.commit();
    count();
    std::this_thread::sleep_for(turn);
  }
  drain();
  bag_.close();
  count();
}

void BagRecorder::drain() noexcept {
  ForceRecord record;
  while (ticks_.pop(record)) bag_.note(record);
  Diagnostic diagnostic;
  while (diagnostics_.pop(diagnostic)) bag_.note(diagnostic);
}

void BagRecorder::count() noexcept {
  const BagWriter& bag = bag_.bag();
  kept_.store(bag.kept(), relaxed);
  lost_.store(bag.lost(), relaxed);
  if (!bag.failed() || failed_.exchange(true, relaxed)) return;
  log(LogLevel::error, "recording_ended",
      "the recording ends after " + std::to_string(bag.kept()) +
          " messages, everything else goes on: " + bag.failure(),
      {{"messages", bag.kept()}});
}

}  // namespace hapticd
