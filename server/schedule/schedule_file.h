// A live run's schedule as a file: everything from which its forces can be made again (schedule_replay.h).
//
// Layout, little-endian: "HAPTICSC", version (u32), byte-order mark (u32), length (u32) and text of a header
// in JSON (scene, its fingerprint, what the plan chose, the devices), then records: a kind (u8) and its
// fields.
//   T  a tick: TickFacts, number and values of the clock's answers
//   S  an action of the simulation's schedule: StepRecord
//   E  the end: ticks and actions that were lost, for a full queue or disk (u64 each)
// A file without E is of a run that did not end well; it is good as far as it goes. Some 0.4 MB a second of
// live time. Errors: the writer throws std::runtime_error naming the file; the reader InputError for a file
// that is none, of another version or byte order, or damaged, naming the record as its line.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "haptic/tick_record.h"
#include "server/scene/scene.h"
#include "server/schedule/step_record.h"

namespace hapticd {

class ScheduleWriter {
 public:
  // The scene as it is run, with what a plan chose; the devices as they start.
  ScheduleWriter(const std::filesystem::path& file, const Scene& scene,
                 const std::vector<DeviceSettings>& devices);

  void write(const TickRecord& tick);
  void write(const StepRecord& step);
  void flush();
  void end(std::uint64_t ticks_lost, std::uint64_t steps_lost);
  bool failed() const { return !out_; }

 private:
  std::ofstream out_;
  std::string buffer_;
};

struct RecordedTick {
  TickFacts facts;
  std::size_t asked = 0;            // times that the clock was asked
  std::size_t first = 0, kept = 0;  // answers, of Schedule::answers
};

struct Schedule {
  std::filesystem::path file;
  std::string header;  // JSON
  std::vector<RecordedTick> ticks;
  std::vector<StepRecord> steps;
  std::vector<std::int32_t> answers;  // of the clock, of all ticks
  bool complete = false;
  std::uint64_t ticks_lost = 0, steps_lost = 0;
};

Schedule read_schedule(const std::filesystem::path& file);

// The scene file that the run read.
std::filesystem::path scene_of(const Schedule& schedule);

// The scene as it was run: what the plan chose, and the device. Throws InputError where `scene` is another
// than the one that was run.
Scene as_run(const Schedule& schedule, Scene scene);

}  // namespace hapticd
