#include "server/schedule/schedule_recorder.h"

#include <chrono>

#include "server/observe/log.h"
#include "server/os/realtime.h"

namespace hapticd {
namespace {

constexpr std::size_t tick_capacity = 4096;  // 4 s of ticks may wait for a slow disk
constexpr std::size_t step_capacity = 4096;
constexpr auto pause = std::chrono::milliseconds(20);

}  // namespace

ScheduleRecorder::ScheduleRecorder(const std::filesystem::path& file, const Scene& scene,
                                   const std::vector<DeviceSettings>& devices)
    : ticks_(tick_capacity), steps_(step_capacity), writer_(file, scene, devices) {}

ScheduleRecorder::~ScheduleRecorder() { stop(); }

void ScheduleRecorder::start(std::optional<int> realtime_core) {
  thread_ = std::thread([this, realtime_core] {
    name_thread("schedule");
    if (realtime_core) leave_core(*realtime_core);
    while (!stopping_.load(std::memory_order_relaxed)) {
      drain();
      std::this_thread::sleep_for(pause);
    }
  });
}

void ScheduleRecorder::drain() {
  std::uint64_t written = 0;
  for (StepRecord step; steps_.pop(step); ++written) writer_.write(step);
  for (; ticks_.pop(tick_); ++written) writer_.write(tick_);
  writer_.flush();
  if (writer_.failed()) {
    unwritten_.fetch_add(written, std::memory_order_relaxed);
    if (!failed_.exchange(true, std::memory_order_relaxed))
      log(LogLevel::warning, "schedule_ended", "the schedule can no longer be written: is the disk full?");
  } else {
    recorded_.fetch_add(written, std::memory_order_relaxed);
  }
}

void ScheduleRecorder::stop() noexcept {
  stopping_ = true;
  if (thread_.joinable()) thread_.join();
  if (std::exchange(ended_, true)) return;
  try {
    drain();
    if (!failed()) writer_.end(ticks_.dropped(), steps_.dropped());
  } catch (const std::exception&) {  // no memory: the file is without its end
    failed_ = true;
  }
}

}  // namespace hapticd
