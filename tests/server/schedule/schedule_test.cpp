// One daemon: a live run and its record run again give the same forces; virtual time keeps the schedule's
// order.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <fstream>
#include <sstream>
#include <thread>

#include <unistd.h>

#include "haptic/clock.h"
#include "server/app/simulation_loop.h"
#include "server/files/input_error.h"
#include "server/scene/scene_reader.h"
#include "server/scene/scene_world.h"
#include "server/schedule/schedule_recorder.h"
#include "server/schedule/schedule_replay.h"
#include "server/schedule/virtual_daemon.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

Scene cube() { return read_scene(SOURCE_DIR "/config/scenes/cube/cube.yaml"); }

class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& name)
      : path_(std::filesystem::temp_directory_path() / (name + std::to_string(getpid()))) {}
  ~TemporaryFile() { std::filesystem::remove(path_); }
  const std::filesystem::path& path() const { return path_; }
  std::string bytes() const {
    std::ostringstream all;
    all << std::ifstream(path_, std::ios::binary).rdbuf();
    return all.str();
  }
  void write(const std::string& bytes) const { std::ofstream(path_, std::ios::binary) << bytes; }

 private:
  std::filesystem::path path_;
};

// Comes down on the middle of the cube by its own count of ticks, slides, and cuts from 0.4 s on.
class ScriptedPort final : public DevicePort {
 public:
  explicit ScriptedPort(const DeviceSettings& device) : device_(device) {}

  bool take(std::int64_t now_ns, DeviceSample& sample) noexcept override {
    const double t = 1e-3 * static_cast<double>(++count_);
    sample = {};
    sample.sequence = static_cast<std::uint64_t>(count_);
    sample.received_ns = now_ns - ms / 4;
    sample.client_time_ns = now_ns;
    sample.pose = to_device(
        device_, {Vec3(10e-3 + 1e-3 * std::sin(5 * t), 10e-3, 23.2e-3 - 2e-3 * std::min(1.0, t / 0.3)),
                  Quat::Identity()});
    sample.enable = t > 0.02;
    sample.buttons = t > 0.4 ? pedal_phaco | pedal_aspiration : 0u;
    return count_ % 17 != 0;  // one is late now and then
  }
  std::int64_t await(std::int64_t until_ns, const EachInstrument<std::int64_t>&) noexcept override {
    sleep_until(until_ns);
    return 0;
  }
  Presence presence() const noexcept override { return {.connected = true, .new_client = count_ == 1}; }
  void write(const ForceSample&) noexcept override {}

 private:
  DeviceSettings device_;
  std::int64_t count_ = 0;
};

struct LiveRun {
  int removed = 0;
  std::uint64_t ticks = 0, lost = 0, interims = 0, refreshes = 0, references = 0;
};

LiveRun run_live(const Scene& scene, const std::filesystem::path& file) {
  PartTimes times(monotonic_ns);
  const std::unique_ptr<World> world = make_world(scene);
  Channel<InstrumentInputs> instruments;
  Channel<CondensedProblem> problems;
  Channel<SceneSnapshot> snapshots;
  Channel<DeviceTuning> tunings;
  SpscQueue<ForceRecord> history(16);
  ScriptedPort port(scene.first().device);
  ScheduleRecorder recorder(file, scene, devices_of(scene));
  SimulationLoop simulation(*world, times, scene.rate, instruments, problems, {&snapshots});
  HapticLoop haptic(world->instruments(), {{scene.first().device, port, history, &tunings}},
                    haptic_options(scene), problems, instruments);
  simulation.record_into(recorder.steps());
  haptic.record_into(recorder.ticks());
  simulation.warm_up();
  recorder.start();
  simulation.start();
  haptic.start();
  // Until something was cut, however little of the machine this test gets.
  const auto wait_for_ticks = [&](std::uint64_t ticks, std::uint64_t removed) {
    for (int i = 0;
         i < 4000 && (haptic.statistics().run < ticks || simulation.statistics().removed < removed); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
  };
  wait_for_ticks(200, 0);
  tunings.back() = tuning_of(scene.first().device);
  tunings.back().force_scale *= 0.8;
  tunings.publish();
  wait_for_ticks(700, 3);
  haptic.stop();
  simulation.stop();
  recorder.stop();
  EXPECT_FALSE(simulation.failed()) << simulation.failure();
  const SimulationStatistics& s = simulation.statistics();
  return {world->removed(),           haptic.statistics().run.load(), recorder.lost(),
          s.interim.snapshot().count, s.refresh.snapshot().count,     s.references.load()};
}

void expect_the_same(Scene scene) {
  const TemporaryFile file("schedule_test");
  const LiveRun live = run_live(scene, file.path());
  const Schedule schedule = read_schedule(file.path());
  EXPECT_TRUE(schedule.complete);
  ASSERT_EQ(live.lost, 0u);
  EXPECT_EQ(schedule.ticks.size(), live.ticks);
  double peak = 0;
  const Reproduction again =
      replay_schedule(as_run(schedule, cube()), schedule, [&](const ReproducedTick& t) {
        peak = std::max(peak, t.force[0].force.norm());
        return true;
      });
  std::printf(
      "  %zu ticks, peak %.3f N, %llu interim problems, %llu refreshes, %d removed, %llu reference "
      "factors: off by %g N\n",
      again.ticks, peak, static_cast<unsigned long long>(live.interims),
      static_cast<unsigned long long>(live.refreshes), live.removed,
      static_cast<unsigned long long>(again.references), again.largest_off);
  EXPECT_EQ(again.ticks, live.ticks);
  EXPECT_LE(again.largest_off, 1e-9);
  EXPECT_LE(again.largest_torque_off, 1e-9);
  EXPECT_EQ(again.other_status, 0u);
  EXPECT_EQ(again.unsure + again.gaps + again.without_problem, 0u);
  EXPECT_GT(peak, 1e-3);
  EXPECT_GT(live.removed, 0);
  EXPECT_EQ(again.removed, live.removed);
}

TEST(Schedule, ALiveRunIsReproducedToTheLastBit) { expect_the_same(cube()); }

TEST(Schedule, ReferenceFactorsAreAdoptedWhereTheyWere) {
  Scene scene = cube();
  scene.compliance = ComplianceMethod::zone;
  expect_the_same(scene);
}

TEST(Schedule, AFileThatIsNoneOrAnotherScenesIsRefusedByName) {
  const TemporaryFile file("schedule_file_test");
  const Scene scene = cube();
  ScheduleWriter(file.path(), scene, devices_of(scene)).end(3, 4);
  const Schedule empty = read_schedule(file.path());
  EXPECT_TRUE(empty.complete);
  EXPECT_EQ(empty.ticks_lost, 3u);
  EXPECT_EQ(empty.steps_lost, 4u);
  EXPECT_NO_THROW(as_run(empty, scene));
  Scene stiffer = scene;
  stiffer.bodies[0].material.young *= 1.01;
  EXPECT_THROW(as_run(empty, stiffer), InputError);

  const std::string whole = file.bytes();
  {
    ScheduleWriter writer(file.path(), scene, devices_of(scene));
    TickRecord tick;
    tick.facts.tick = 7;
    tick.clock.count = 2;
    tick.clock.left_ns[0] = 5;
    tick.clock.left_ns[1] = -6;
    writer.write(tick);
    writer.write(StepRecord{.action = StepAction::refresh, .problem = 9});
    writer.end(0, 0);
  }
  const std::string two = file.bytes();
  const Schedule read = read_schedule(file.path());
  ASSERT_EQ(read.ticks.size(), 1u);
  ASSERT_EQ(read.steps.size(), 1u);
  EXPECT_EQ(read.ticks[0].facts.tick, 7u);
  EXPECT_EQ(read.answers, (std::vector<std::int32_t>{5, -6}));
  EXPECT_EQ(read.steps[0].action, StepAction::refresh);
  EXPECT_EQ(read.steps[0].problem, 9u);

  // Cut anywhere behind its header it is good as far as it goes; elsewhere, or damaged, it is refused.
  for (const std::size_t cut : {two.size() - 1, two.size() - 18, whole.size() - 10, whole.size() - 17}) {
    file.write(two.substr(0, cut));
    EXPECT_FALSE(read_schedule(file.path()).complete) << cut;
  }
  for (const std::size_t cut : {0u, 4u, 17u, 40u}) {
    file.write(two.substr(0, cut));
    EXPECT_THROW(read_schedule(file.path()), InputError) << cut;
  }
  std::string damaged = two;
  damaged[whole.size() - 17] = 'X';
  file.write(damaged);
  try {
    read_schedule(file.path());
    ADD_FAILURE();
  } catch (const InputError& e) {
    EXPECT_EQ(e.file(), file.path());
    EXPECT_EQ(e.line(), 1);  // the first record
  }
  std::string newer = two;
  newer[8] = 99;
  file.write(newer);
  EXPECT_THROW(read_schedule(file.path()), InputError);
}

// A step in contact that removes something: what happens when, by the default timing.
TEST(VirtualDaemon, ActionsComeAtTheirTimes) {
  Scene scene = cube();
  std::vector<std::pair<StepAction, std::int64_t>> seen;
  VirtualDaemonSettings settings;
  settings.before = [&](StepAction action, std::int64_t ns) { seen.emplace_back(action, ns - 1000 * ms); };
  VirtualDaemon daemon(make_world(scene), scene.rate, scene.first().device, haptic_options(scene), settings);
  auto tick = [&, k = 0](int milliseconds) mutable {
    for (int i = 0; i < milliseconds; ++i, ++k) {
      HapticInput input;
      input.now_ns = (1000 + k) * ms;
      input.device[0].presence = {.connected = true, .new_client = k == 0};
      input.device[0].taken = true;
      input.device[0].sample.sequence = static_cast<std::uint64_t>(k + 1);
      input.device[0].sample.received_ns = input.now_ns;
      input.device[0].sample.enable = true;
      input.device[0].sample.pose =
          to_device(scene.first().device, {Vec3(10e-3, 10e-3, 22.2e-3), Quat::Identity()});
      if (k == 40) daemon.schedule_removal(0, {5, 6});
      daemon.tick(input);
    }
  };
  using A = StepAction;
  using Seen = std::vector<std::pair<A, std::int64_t>>;
  tick(20);
  EXPECT_EQ(seen, (Seen{{A::begin, 0}, {A::factor, 0}, {A::finish, 1 * ms}, {A::publish, 10 * ms}}));
  tick(20);
  seen.clear();
  tick(20);
  ASSERT_GE(seen.size(), 5u);
  seen.resize(7, {A::begin, -1});
  EXPECT_EQ(seen[0], (Seen::value_type{A::begin, 40 * ms}));
  EXPECT_EQ(seen[1], (Seen::value_type{A::publish_interim, 42 * ms}));
  EXPECT_EQ(seen[2], (Seen::value_type{A::factor, 42 * ms}));
  EXPECT_EQ(seen[3], (Seen::value_type{A::finish, 44 * ms}));
  EXPECT_EQ(seen[4], (Seen::value_type{A::publish, 50 * ms}));
  EXPECT_EQ(seen[5], (Seen::value_type{A::refresh, 52 * ms}));
}

// Published 50 ms after its begin; the next begins at once, and leaves out the one that has passed.
TEST(VirtualDaemon, AStepMayTakeLongerThanItsPeriod) {
  const Scene scene = cube();
  using Seen = std::vector<std::pair<StepAction, std::int64_t>>;
  Seen seen;
  VirtualDaemonSettings settings;
  settings.timing = {.latch = 1 * ms, .publish = 20 * ms, .late = 30 * ms};
  settings.before = [&](StepAction action, std::int64_t ns) { seen.emplace_back(action, ns - 1000 * ms); };
  VirtualDaemon daemon(make_world(scene), scene.rate, scene.first().device, haptic_options(scene), settings);
  daemon.advance(1100 * ms);
  using A = StepAction;
  EXPECT_EQ(seen, (Seen{{A::begin, 0},
                        {A::factor, 0},
                        {A::finish, 11 * ms},
                        {A::publish, 50 * ms},
                        {A::begin, 50 * ms},
                        {A::factor, 50 * ms},
                        {A::finish, 61 * ms},
                        {A::publish, 100 * ms}}));
}

// Whoever is late leaves out grid points; whoever is less than a period late begins at once.
TEST(StepSchedule, LeavesOutWhatHasPassed) {
  Scene scene = cube();
  const std::unique_ptr<World> world = make_world(scene);
  struct Host final : StepHost {
    CondensedProblem* slot;
    InstrumentSamples latch() override { return {}; }
    CondensedProblem& problem() override { return *slot; }
    void publish(StepAction) override {}
    std::optional<ReferenceJob> finished_reference() override { return std::nullopt; }
    void make_reference(ReferenceJob) override {}
  } host;
  const auto problem = std::make_unique<CondensedProblem>();
  host.slot = problem.get();
  StepSchedule schedule(*world, 20 * ms);
  schedule.warm_up(*problem);
  schedule.start(5 * ms);
  const auto step = [&](std::int64_t now) {
    const PlannedAction begin = schedule.next(now);
    PlannedAction next = begin;
    do schedule.perform(next, host);
    while ((next = schedule.next(now)).action != StepAction::begin);
    return begin;
  };
  EXPECT_EQ(step(6 * ms).step_ns, 5 * ms);
  EXPECT_EQ(schedule.next(15 * ms).due_ns, 25 * ms);
  EXPECT_EQ(schedule.next(45 * ms).due_ns, 25 * ms);  // a period late, and not more
  EXPECT_EQ(schedule.next(45 * ms).skipped, 0);
  EXPECT_EQ(schedule.next(46 * ms).due_ns, 45 * ms);
  EXPECT_EQ(schedule.next(46 * ms).skipped, 1);
  EXPECT_EQ(step(107 * ms).step_ns, 105 * ms);
  EXPECT_EQ(schedule.next(110 * ms).due_ns, 125 * ms);
}

}  // namespace
}  // namespace hapticd
