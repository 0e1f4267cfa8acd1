#include "haptic/loop.h"

#include <chrono>
#include <functional>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "tests/haptic/wall.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

// A client that answers every tick with a pose inside the wall, and once takes 20 ms to write.
class FakePort final : public DevicePort {
 public:
  std::vector<std::int64_t> begun;  // of each tick
  std::vector<std::uint32_t> status;
  std::int64_t stall_began = 0;
  int stall_at = -1;
  ForceSample last;

  FakePort() {
    begun.reserve(10'000);
    status.reserve(10'000);
  }
  bool take(std::int64_t now_ns, DeviceSample& sample) noexcept override {
    begun.push_back(now_ns);
    sample = {};
    sample.sequence = begun.size();
    sample.received_ns = now_ns;
    sample.enable = true;
    sample.pose.p.z() = wall::radius - 0.1e-3;
    return true;
  }
  std::int64_t await(std::int64_t until_ns) noexcept override { return wait(until_ns); }
  std::function<std::int64_t(std::int64_t)> wait = [](std::int64_t) { return std::int64_t{0}; };
  Presence presence() const noexcept override { return {.connected = true, .new_client = begun.size() == 1}; }
  void write(const ForceSample& force) noexcept override {
    last = force;
    status.push_back(force.status);
    if (static_cast<int>(begun.size()) != stall_at || stall_began) return;
    stall_began = monotonic_ns();
    while (monotonic_ns() - stall_began < 20 * ms) {
    }
  }
};

struct Loop : testing::Test {
  Instrument instrument = wall::instrument();
  DeviceSettings device;
  HapticOptions options;
  FakePort port;
  Channel<CondensedProblem> problems;
  Channel<InstrumentInput> inputs;
  SpscQueue<ForceRecord> history{1024};

  Loop() {
    device.max_force = 3;
    device.max_force_rate = 1e4;
    device.max_speed = 1;
    options.watchdog.problem_old_ns = 10'000 * ms;  // one problem serves the whole test
    options.watchdog.problem_lost_ns = 20'000 * ms;
    wall::make(problems.back(), 1, monotonic_ns());
    problems.publish();
  }
  void run(HapticLoop& loop, int milliseconds) {
    loop.start();
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
    loop.stop();
  }
};

TEST_F(Loop, AfterAStallSlotsAreLeftOutAndNeverMadeUpForInABurst) {
  port.stall_at = 100;
  HapticLoop loop(instrument, device, options, port, problems, inputs, history);
  run(loop, 300);
  const LoopStatistics& s = loop.statistics();
  ASSERT_GT(port.stall_began, 0);
  EXPECT_GE(s.missed.load(), 19u);
  EXPECT_GE(s.deadline_misses.load(), 1u);
  EXPECT_EQ(s.run.load(), port.begun.size());
  // Every slot of the elapsed time is accounted for, run or missed.
  EXPECT_EQ(s.next_ns.load() - s.first_ns.load(), static_cast<std::int64_t>(s.scheduled()) * ms);
  // In any 10 ms no more ticks than slots (and the one that opens the window).
  for (std::size_t i = 0; i + 11 < port.begun.size(); ++i)
    EXPECT_GT(port.begun[i + 11] - port.begun[i], 10 * ms);
  // The slots behind the stall count with the time that they had to wait.
  EXPECT_GE(s.wake.snapshot().count, s.scheduled());
  EXPECT_GE(s.wake.snapshot().max, 18 * ms);
  // The first tick after the stall knows of its own gap.
  EXPECT_TRUE(port.status[100] & status_gap);
}

TEST_F(Loop, EveryTickIsAnsweredRecordedAndCounted) {
  HapticLoop loop(instrument, device, options, port, problems, inputs, history);
  bool hooked = false;
  loop.start([&] { hooked = true; });
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  loop.stop();
  EXPECT_TRUE(hooked);
  const LoopStatistics& s = loop.statistics();
  EXPECT_GT(s.run.load(), 50u);
  EXPECT_EQ(s.answered.load(), s.run.load());
  EXPECT_EQ(s.problem_age.snapshot().count, s.run.load());
  EXPECT_EQ(s.refused.load(), 0u);
  EXPECT_GT(s.force_peak.load(), 0);
  EXPECT_LE(s.force_peak.load(), wall::stiffness * 0.1e-3 * (1 + 1e-6));

  ForceRecord record;
  std::uint64_t records = 0;
  std::int64_t last = 0;
  while (history.pop(record)) {
    ++records;
    EXPECT_EQ(record.force.sequence, records);
    EXPECT_EQ((record.time_ns - s.first_ns.load()) % ms, 0);  // intended times lie on the grid
    EXPECT_GT(record.time_ns, last);
    last = record.time_ns;
  }
  EXPECT_EQ(records, s.run.load());
  ASSERT_TRUE(inputs.acquire());
  EXPECT_TRUE(inputs.front().present);
  EXPECT_EQ(inputs.front().sequence, s.run.load());
}

TEST_F(Loop, LastForceIsZeroAndDisarmedAndStopMayBeCalledTwice) {
  HapticLoop loop(instrument, device, options, port, problems, inputs, history);
  run(loop, 50);
  EXPECT_EQ(port.last.force, Vec3::Zero());
  EXPECT_EQ(port.last.status, status_disarmed);
  loop.stop();
}

}  // namespace
}  // namespace hapticd
