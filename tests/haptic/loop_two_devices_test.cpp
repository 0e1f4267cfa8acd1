// The loop with two devices: who is waited for, what is answered when, and whose figures are whose.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "haptic/clock.h"
#include "tests/haptic/loop_on_wall.h"

namespace hapticd {
namespace {


// A device whose states a test sends, or which sends one for each tick.
class TestPort final : public DevicePort {
 public:
  explicit TestPort(const std::vector<TestPort*>& all) : all_(all) { written.reserve(100'000); }

  // Another thread than the loop's.
  void send() { sent_.fetch_add(1, std::memory_order_release); }

  bool take(std::int64_t now_ns, DeviceSample& sample) noexcept override {
    ++takes;
    new_ = false;
    const std::uint64_t newest = each_tick ? each_tick(tick()) : sent_.load(std::memory_order_acquire);
    if (newest == taken_) return false;
    new_ = taken_ == 0;
    taken_ = newest;
    sample = LoopOnWall::pressing(newest, now_ns);
    return true;
  }
  std::int64_t await(std::int64_t until_ns, const EachInstrument<std::int64_t>& earliest) noexcept override {
    for (std::int64_t now = monotonic_ns(); now < until_ns; now = monotonic_ns()) {
      for (std::size_t i = 0; i < all_.size(); ++i)
        if (all_[i]->sent_.load(std::memory_order_acquire) != all_[i]->taken_ &&
            now >= earliest[static_cast<int>(i)])
          return now;
      sleep_until(now + 10'000);
    }
    return 0;
  }
  Presence presence() const noexcept override {
    return {.connected = taken_ > 0 && connected.load(), .new_client = new_};
  }
  void write(const ForceSample& force) noexcept override {
    if (written.size() < written.capacity()) written.push_back(force);
    ticks_.store(written.size(), std::memory_order_release);
  }

  std::size_t ticks() const { return ticks_.load(std::memory_order_acquire); }
  int tick() const { return static_cast<int>(written.size()) + 1; }

  std::function<std::uint64_t(int tick)> each_tick;  // the newest state's number then
  std::atomic<bool> connected{true};
  std::vector<ForceSample> written;  // a test may read the first ticks()
  int takes = 0;

 private:
  const std::vector<TestPort*>& all_;
  std::atomic<std::uint64_t> sent_{0};
  std::atomic<std::size_t> ticks_{0};
  std::uint64_t taken_ = 0;
  bool new_ = false;
};

struct LoopOfTwo : testing::TestWithParam<int>, LoopOnWall {
  std::vector<Instrument> instruments{wall::instrument(), wall::instrument()};
  std::vector<TestPort*> ports;
  TestPort both[2]{TestPort(ports), TestPort(ports)};
  const int a = GetParam(), b = 1 - a;  // the one that behaves, and the other
  TestPort &first = both[a], &second = both[b];
  SpscQueue<ForceRecord> history[2]{SpscQueue<ForceRecord>(1024), SpscQueue<ForceRecord>(1024)};

  LoopOfTwo() { ports = {&both[0], &both[1]}; }
  std::vector<LoopDevice> devices() { return {{device, both[0], history[0]}, {device, both[1], history[1]}}; }
  // So many ticks at least, on whatever machine.
  void run(HapticLoop& loop, std::size_t ticks) {
    loop.start();
    const std::int64_t begun = monotonic_ns();
    while (first.ticks() < ticks && monotonic_ns() - begun < 20'000 * ms)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    loop.stop();
    ASSERT_GE(first.ticks(), ticks);
  }
};

TEST_P(LoopOfTwo, InModeEventEachArrivalIsAnsweredAtOnceWithTheOthersNewestPose) {
  HapticLoop loop(instruments, devices(), options, problems, inputs, {.mode = LoopMode::event});
  loop.start();
  EachInstrument<std::uint64_t> sent;
  std::vector<std::int64_t> waited;
  for (int n = 0; n < 200; ++n) {
    const int i = n % 2;
    TestPort& port = both[i];
    const std::size_t from = port.ticks();
    const std::int64_t begun = monotonic_ns();
    ++sent[i];
    port.send();
    std::size_t k = from;
    for (; monotonic_ns() - begun < 5'000 * ms; ++k) {
      while (k >= port.ticks() && monotonic_ns() - begun < 5'000 * ms) sleep_until(monotonic_ns() + 20'000);
      if (k < port.ticks() && port.written[k].echo_sequence == sent[i]) break;
    }
    ASSERT_LT(k, port.ticks()) << "no answer to state " << sent[i] << " of device " << i;
    waited.push_back(monotonic_ns() - begun);
    const TestPort& other = both[1 - i];
    while (k >= other.ticks()) std::this_thread::yield();
    EXPECT_TRUE(port.written[k].answers);
    EXPECT_FALSE(other.written[k].answers);
    EXPECT_EQ(other.written[k].echo_sequence, sent[1 - i]);
    EXPECT_EQ(other.written[k].sequence, port.written[k].sequence);  // of one tick
  }
  loop.stop();
  // Not at the next millisecond: half of them within half of one.
  std::nth_element(waited.begin(), waited.begin() + 100, waited.end());
  EXPECT_LT(waited[100], ms / 2);
  for (int i = 0; i < 2; ++i) EXPECT_EQ(loop.statistics(i).answered.load(), 100u);
}

// One flood is answered as often as that of a single device. The other one is answered between, whenever it
// comes.
TEST_P(LoopOfTwo, InModeEventAFloodIsAnsweredTwiceAMillisecondAndHoldsUpNobody) {
  HapticLoop loop(instruments, devices(), options, problems, inputs, {.mode = LoopMode::event});
  const std::int64_t begun = monotonic_ns();
  loop.start();
  std::uint64_t sent = 0;
  for (std::int64_t now = begun; now - begun < 400 * ms; now = monotonic_ns()) {
    second.send();
    if (now - begun > static_cast<std::int64_t>(3 * sent) * ms) {
      first.send();
      ++sent;
    }
    sleep_until(now + 20'000);
  }
  loop.stop();
  const double seconds = 1e-9 * static_cast<double>(monotonic_ns() - begun);
  const auto most = static_cast<std::uint64_t>(2000 * seconds) + 2;
  EXPECT_LE(loop.statistics(b).answered.load(), most);
  EXPECT_GT(loop.statistics(b).answered.load(), 100u);
  EXPECT_LE(loop.statistics(a).run.load(), most + sent + static_cast<std::uint64_t>(1000 * seconds));
  // One that the machine held up is overtaken by the next.
  EXPECT_GE(loop.statistics(a).answered.load(), sent / 2);
}

TEST_P(LoopOfTwo, WhoDoesNotAnswerIsWaitedForOnceAndTheOtherIsAnsweredInEachTick) {
  first.each_tick = [](int tick) { return static_cast<std::uint64_t>(tick); };
  second.each_tick = [](int tick) { return static_cast<std::uint64_t>(std::min(tick, 50)); };
  HapticLoop loop(instruments, devices(), options, problems, inputs);
  run(loop, 200);
  const LoopStatistics& s = loop.statistics(a);
  EXPECT_EQ(s.answered.load(), s.run.load());
  EXPECT_EQ(first.takes, static_cast<int>(s.run.load()));
  EXPECT_EQ(loop.statistics(b).answered.load(), 50u);
  EXPECT_EQ(loop.statistics(b).late_states.load(), 0u);
  const int silent = static_cast<int>(s.run.load()) - 50;
  EXPECT_LE(second.takes - 50 - silent, 7);  // 0.35 ms of one tick, looked at each 0.05
  // The silent one is held, then ramps down, then is disarmed, and the other feels its own wall alone.
  const ForceSample& last = first.written[first.written.size() - 2];
  EXPECT_EQ(last.status & (status_disarmed | status_holding), 0u);
  EXPECT_TRUE(second.written[second.written.size() - 2].status & status_disarmed);
}

TEST_P(LoopOfTwo, AClientThatIsGoneIsNotWaitedFor) {
  first.each_tick = [](int tick) { return static_cast<std::uint64_t>(tick); };
  second.each_tick = [this](int tick) {
    if (tick > 50) second.connected = false;
    return static_cast<std::uint64_t>(std::min(tick, 50));
  };
  HapticLoop loop(instruments, devices(), options, problems, inputs);
  run(loop, 150);
  EXPECT_EQ(second.takes, static_cast<int>(loop.statistics(b).run.load()));
  EXPECT_EQ(second.written[50].force, Vec3::Zero());
  EXPECT_EQ(loop.statistics(a).answered.load(), loop.statistics(a).run.load());
}

TEST_P(LoopOfTwo, TheLastForceOfEachIsZeroAndDisarmed) {
  for (TestPort* port : ports) port->each_tick = [](int tick) { return static_cast<std::uint64_t>(tick); };
  HapticLoop loop(instruments, devices(), options, problems, inputs);
  run(loop, 150);
  for (const TestPort* port : ports) {
    EXPECT_GT(port->written[port->written.size() - 2].force.norm(), 0);
    EXPECT_EQ(port->written.back().force, Vec3::Zero());
    EXPECT_EQ(port->written.back().status, status_disarmed);
  }
}

// One of the two has no client: solves that end at a cap are captured all the same.
TEST_P(LoopOfTwo, ASolveThatEndsAtACapIsCapturedWhicheverDeviceFeelsIt) {
  const int felt = GetParam();
  both[felt].each_tick = [](int tick) { return static_cast<std::uint64_t>(tick); };
  options.contact.coulomb.max_sweeps = options.contact.coulomb.max_newton = 0;
  options.contact.coulomb.tolerance = 0;  // or normal forces alone solve it
  problems.acquire();
  problems.back() = problems.front();
  problems.back().sample[0].friction = 0.3;
  problems.back().step = 2;
  problems.publish();
  Channel<ContactCapture> captures;
  HapticLoop loop(instruments, devices(), options, problems, inputs);
  loop.capture_into(captures, 0);
  run(loop, 150);
  ASSERT_GT(loop.statistics(felt).solver_caps.load(), 0u);
  EXPECT_EQ(loop.statistics(1 - felt).solver_caps.load(), 0u);
  ASSERT_TRUE(captures.acquire());
  EXPECT_EQ(captures.front().status, SolveStatus::iteration_cap);
  EXPECT_GT(captures.front().residual, 0);
  EXPECT_TRUE(captures.front().X.present[felt]);
}

INSTANTIATE_TEST_SUITE_P(Either, LoopOfTwo, testing::Values(0, 1),
                         [](const auto& p) { return p.param == 0 ? "First" : "Second"; });

}  // namespace
}  // namespace hapticd
