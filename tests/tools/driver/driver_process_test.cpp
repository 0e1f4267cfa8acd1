// The driver library against the daemon as a real process: force felt, and zero whatever ends.
#include <cmath>
#include <csignal>
#include <fstream>
#include <functional>
#include <iterator>
#include <memory>
#include <stdexcept>

#include <gtest/gtest.h>
#include <time.h>

#include "tests/support/process.h"
#include "tests/tools/run_command.h"
#include "tools/driver/driver.h"

namespace hapticd {
namespace {

const std::string cube = SOURCE_DIR "/config/scenes/cube/cube.yaml";

std::string text_of(const std::string& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

double seconds() {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// Pressed into the top of the cube; `each` is asked after every write and ends the run with false.
class Pressed final : public HapticDevice {
 public:
  explicit Pressed(std::function<bool(Pressed&)> each) : each_(std::move(each)) {}
  bool read(Reading& reading) override {
    // Down to 1.5 mm deep in a second, slower than the device's max_speed by far.
    reading.position = {0, 0, std::max(0.0215, 0.030 - 0.0085e-3 * ticks_++)};
    return each_(*this);
  }
  void write(const Feel& feel) override {
    force = std::hypot(feel.force[0], feel.force[1], feel.force[2]);
    status = feel.status;
    if (force > 0) last_felt = seconds();
    peak = std::max(peak, force);
  }
  double force = -1, peak = 0, last_felt = 0;
  std::uint32_t status = 0;

 private:
  std::function<bool(Pressed&)> each_;
  int ticks_ = 0;
};

class DriverProcess : public testing::Test {
 protected:
  DriverProcess() : domain_(static_cast<std::uint32_t>(40 + getpid() % 60)) {
    options_.domain = domain_;
    options_.device = "touch";
    options_.duration = 20;
    start();
  }
  void start() {
    daemon_ = std::make_unique<ChildProcess>(
        std::vector<std::string>{BIN_DIR "/hapticd", cube, "--domain", std::to_string(domain_)});
  }
  std::uint32_t domain_;
  DriverOptions options_;
  std::unique_ptr<ChildProcess> daemon_;
};

TEST_F(DriverProcess, FeelsTheCubeAndEndsAtZeroOnASignal) {
  int felt = 0;
  Pressed device([&](Pressed& d) {
    felt += d.force > 0.02 && d.status == 0;
    if (felt == 2000) raise(SIGTERM);
    return true;
  });
  const DriverReport report = run_driver(device, options_);
  EXPECT_EQ(report.end, DriverReport::End::signal);
  EXPECT_GT(device.peak, 0.02);
  EXPECT_EQ(device.force, 0);
  EXPECT_GT(report.answered, 2000u);  // each is felt in the slot of its pose
  // The handler is given back.
  struct sigaction now {};
  sigaction(SIGTERM, nullptr, &now);
  EXPECT_EQ(now.sa_handler, SIG_DFL);
}

TEST_F(DriverProcess, ZeroWhenTheDaemonDiesAndForceAgainWhenItComesBack) {
  double killed = 0, restarted = 0;
  double felt_after = 0, peak_again = 0;
  Pressed device([&](Pressed& d) {
    if (killed == 0 && d.force > 0.02) {
      daemon_->signal(SIGKILL);
      killed = seconds();
    } else if (killed > 0 && restarted == 0 && seconds() - killed > 0.5) {
      EXPECT_EQ(d.force, 0);
      felt_after = d.last_felt - killed;
      start();
      restarted = seconds();
    } else if (restarted > 0) {
      peak_again = std::max(peak_again, d.force);
      return peak_again < 0.02;
    }
    return true;
  });
  const DriverReport report = run_driver(device, options_);
  EXPECT_EQ(report.end, DriverReport::End::device_lost);
  EXPECT_LT(felt_after, 0.030);  // 10 ms, and the machine's lateness
  EXPECT_GT(peak_again, 0.02);
  EXPECT_GE(report.silences, 1u);
  EXPECT_EQ(device.force, 0);
}

TEST_F(DriverProcess, AnExceptionOfTheDeviceLeavesZeroBehindAndIsPassedOn) {
  Pressed device([](Pressed& d) {
    if (d.force > 0.02) throw std::runtime_error("the cable is out");
    return true;
  });
  EXPECT_THROW(run_driver(device, options_), std::runtime_error);
  EXPECT_GT(device.peak, 0.02);
  EXPECT_EQ(device.force, 0);
}

TEST_F(DriverProcess, AStalledDriverIsArmedAgainByItself) {
  int stage = 0;
  Pressed device([&](Pressed& d) {
    if (stage == 0 && d.force > 0.02 && d.status == 0) {
      usleep(300'000);  // the daemon has disarmed
      stage = 1;
    } else if (stage == 1 && d.force == 0) {
      stage = 2;
    } else if (stage == 2 && d.force > 0.02 && d.status == 0) {
      return false;
    }
    return true;
  });
  EXPECT_EQ(run_driver(device, options_).end, DriverReport::End::device_lost);
  EXPECT_EQ(stage, 2);
}

TEST_F(DriverProcess, TheSecondClientOfADeviceFeelsNothing) {
  const ScratchDirectory scratch;
  const std::string output = scratch.file("second");
  std::unique_ptr<ChildProcess> second;
  double begun = 0;
  bool asked = false;
  Pressed first([&](Pressed& d) {
    if (!second && d.force > 0.02 && d.status == 0) {
      second = std::make_unique<ChildProcess>(
          std::vector<std::string>{BIN_DIR "/example_driver", std::to_string(domain_)}, output);
      begun = seconds();
    }
    // The example's tip is deepest after two seconds. It ends before the device is free.
    if (second && !asked && seconds() - begun > 3.0) {
      second->signal(SIGINT);
      asked = true;
    }
    return !second || seconds() - begun < 3.5;
  });
  run_driver(first, options_);
  ASSERT_TRUE(second);
  EXPECT_EQ(second->wait(3000), 0);
  EXPECT_NE(text_of(output).find(" 0 answered"), std::string::npos) << text_of(output);
  EXPECT_NE(text_of(output).find("peak force 0.0000 N"), std::string::npos) << text_of(output);
}

TEST_F(DriverProcess, TheExampleRunsUntilItsSignalAndWroteZeroLast) {
  const ScratchDirectory scratch;
  const std::string output = scratch.file("example");
  ChildProcess example({BIN_DIR "/example_driver", std::to_string(domain_)}, output);
  usleep(10'000'000);  // a busy machine takes seconds to begin
  example.signal(SIGINT);
  EXPECT_EQ(example.wait(3000), 0);
  const std::string text = text_of(output);
  unsigned long long sent = 0, answered = 0;
  double longest = 0, peak = 0, last = -1;
  EXPECT_EQ(text.find("presses into the daemon of DDS domain " + std::to_string(domain_)), 0u) << text;
  ASSERT_EQ(std::sscanf(text.c_str() + text.find('\n') + 1,
                        "%llu states sent, %llu answered, %lf ms without a force at most\n"
                        "peak force %lf N, last force written %lf N",
                        &sent, &answered, &longest, &peak, &last),
            5)
      << text;
  EXPECT_GT(sent, 5000u);
  EXPECT_GT(answered, 3000u);
  EXPECT_GT(peak, 0.02);
  EXPECT_EQ(last, 0);
}

}  // namespace
}  // namespace hapticd
