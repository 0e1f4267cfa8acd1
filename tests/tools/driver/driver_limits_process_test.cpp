// What a driver's device feels of daemons that lie, fall silent or are two, and of a driver that dies: each
// in a process of its own, which tells all that it wrote.
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <thread>

#include <fcntl.h>
#include <unistd.h>

#include <gtest/gtest.h>

#include "haptic/clock.h"
#include "server/files/input_error.h"
#include "server/files/paths.h"
#include "tests/support/process.h"
#include "tests/tools/fake_daemon.h"
#include "tests/tools/run_command.h"
#include "tools/driver/driver.h"

namespace hapticd {
namespace {

constexpr double touch_step = 0.2, touch_most = 3.3;  // N a slot, N

struct Written {
  std::int64_t at_ns = 0;
  double force = 0;
  std::uint32_t status = 0;
};

// 10 mm off the origin; `enough` newtons make it do `deed`.
class Told final : public HapticDevice {
 public:
  Told(const std::string& file, std::string deed, double enough)
      : file_(open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600)),
        deed_(std::move(deed)),
        enough_(enough) {}
  bool read(Reading& reading) override {
    reading.position = {0, 0, 0.010};
    if (force_ < enough_) return true;
    if (deed_ == "lost") return false;
    if (deed_ == "caught" || deed_ == "uncaught") throw std::runtime_error("the cable is out");
    // The driver's thread stands meanwhile.
    if (deed_ == "terminate_elsewhere") std::thread([] { throw std::runtime_error("nobody's"); }).join();
    held_ = deed_ == "abort_held";
    if (deed_ == "abort" || held_) std::abort();
    if (deed_ == "fault") raise(SIGSEGV);
    if (deed_ == "exit") std::exit(0);
    if (deed_ == "signal") raise(SIGTERM);
    if (deed_ == "abort_elsewhere") std::thread([] { std::abort(); }).detach();
    if (deed_ == "exit_elsewhere") std::thread([] { std::exit(0); }).detach();
    deed_.clear();
    return true;
  }
  void write(const Feel& feel) override {
    while (held_) ::pause();  // a lock of its own
    force_ = std::hypot(feel.force[0], feel.force[1], feel.force[2]);
    const Written w{monotonic_ns(), force_, feel.status};
    if (::write(file_, &w, sizeof w) != sizeof w) std::_Exit(99);
  }

 private:
  int file_;
  std::string deed_;
  double enough_, force_ = 0;
  bool held_ = false;
};

// The other process (below), which the tests start.
TEST(DriverChild, DISABLED_Run) {
  const char* domain = std::getenv("DRIVER_DOMAIN");
  ASSERT_NE(domain, nullptr);
  DriverOptions options;
  options.domain = static_cast<std::uint32_t>(std::atoi(domain));
  options.device = "touch";
  options.duration = 20;
  const std::string deed = std::getenv("DRIVER_DEED");
  Told device(std::getenv("DRIVER_FILE"), deed, 0.9);
  if (deed != "caught") {
    run_driver(device, options);
    return;
  }
  try {
    run_driver(device, options);
  } catch (const std::exception&) {
    std::_Exit(3);
  }
}

class DriverLimits : public testing::Test {
 protected:
  std::unique_ptr<ChildProcess> start(const std::string& deed = "stay") {
    setenv("DRIVER_DOMAIN", std::to_string(id_).c_str(), 1);
    setenv("DRIVER_FILE", file_.c_str(), 1);
    setenv("DRIVER_DEED", deed.c_str(), 1);
    return std::make_unique<ChildProcess>(std::vector<std::string>{
        std::filesystem::read_symlink("/proc/self/exe").string(), "--gtest_filter=DriverChild.DISABLED_Run",
        "--gtest_also_run_disabled_tests", "--gtest_catch_exceptions=0"});
  }
  std::vector<Written> written() const {
    std::vector<Written> out;
    std::ifstream in(file_, std::ios::binary);
    for (Written w; in.read(reinterpret_cast<char*>(&w), sizeof w);) out.push_back(w);
    return out;
  }
  bool await(const std::function<bool(const Written&)>& such, int milliseconds = 20'000) const {
    for (int i = 0; i < milliseconds; i += 5) {
      const auto all = written();
      if (!all.empty() && such(all.back())) return true;
      pause(5);
    }
    return false;
  }
  static void pause(int milliseconds) {
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
  }
  // zeros: how many of its steps to zero need not keep the slew limit.
  static void expect_limits(const std::vector<Written>& all, int zeros = 0) {
    double before = 0;
    for (const Written& w : all) {
      EXPECT_LE(w.force, touch_most + 1e-9);
      if (std::abs(w.force - before) > touch_step + 1e-9) {
        EXPECT_EQ(w.force, 0);
        --zeros;
      }
      before = w.force;
    }
    EXPECT_GE(zeros, 0);
  }
  static double peak(const std::vector<Written>& all) {
    double most = 0;
    for (const Written& w : all) most = std::max(most, w.force);
    return most;
  }

  const ScratchDirectory scratch_;
  const std::string file_ = scratch_.file("written");
  const std::uint32_t id_ = test_domain();
};

TEST_F(DriverLimits, NoDeviceNoStart) {
  Told device(file_, "", 0.9);
  EXPECT_THROW(run_driver(device, {}), std::invalid_argument);
  DriverOptions options;
  options.device = "tuch";
  EXPECT_THROW(run_driver(device, options), InputError);
  options.device = scratch_.file("mine.yaml", "device: mine\nmax_force: .inf\n");
  try {
    run_driver(device, options);
    FAIL() << "started";
  } catch (const InputError& e) {
    EXPECT_EQ(e.key(), "max_force");
    EXPECT_EQ(e.line(), 2);
  }
  EXPECT_TRUE(written().empty());  // not even zero
}

// Whoever plays the daemon and echoes numbers.
class Liar {
 public:
  explicit Liar(std::uint32_t domain)
      : domain_(domain, read_dds_profile("loopback")),
        participant_(domain_),
        states_(participant_),
        forces_(participant_) {
    thread_ = std::thread([this] { run(); });
  }
  ~Liar() {
    stopping_ = true;
    thread_.join();
  }

 private:
  void run() {
    int n = 0;
    while (!stopping_) {
      states_.take_each([&](const hapticd_msg_DeviceState& state, const dds_sample_info_t&) {
        hapticd_msg_ForceCommand f{};
        f.echo_number = state.number;
        f.echo_client_time_ns = state.client_time_ns;
        const bool lie = ++n % 1000 > 900;
        f.force[2] = lie ? n % 3 == 0 ? std::nan("") : n % 3 == 1 ? -1e9 : 1e308 : 1e9;
        f.torque[0] = 1e9;
        forces_.write(f);
      });
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
  }
  Domain domain_;
  Participant participant_;
  Reader<hapticd_msg_DeviceState> states_;
  Writer<hapticd_msg_ForceCommand> forces_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

TEST_F(DriverLimits, AnEchoOfABillionNewtonsIsTheDevicesMaximumAtItsSlewLimit) {
  const Liar liar(id_);
  const auto driver = start();
  ASSERT_TRUE(await([](const Written& w) { return w.force > 3.2; }));
  pause(3000);
  driver->signal(SIGTERM);
  EXPECT_EQ(driver->wait(5000), 0);
  const auto all = written();
  EXPECT_NEAR(peak(all), touch_most, 1e-9);
  EXPECT_EQ(all.back().force, 0);
  int falls = 1;  // the end; each NaN is zero at once
  for (const Written& w : all) falls += (w.status & status_not_finite) != 0;
  EXPECT_GT(falls, 1);
  expect_limits(all, 2 * falls + 10);
}

class DriverEnds : public DriverLimits, public testing::WithParamInterface<std::pair<const char*, int>> {};

TEST_P(DriverEnds, AtZero) {
  const FakeDaemon daemon(id_, 100);  // 1 N
  const auto driver = start(GetParam().first);
  const int ended = driver->wait(20'000);
  // Threads that go on while another one exits may meet what is destroyed: forces are at zero by then.
  if (std::string(GetParam().first) != "exit_elsewhere" || ended != -SIGSEGV) {
    EXPECT_EQ(ended, GetParam().second);
  }
  const auto all = written();
  ASSERT_FALSE(all.empty());
  EXPECT_GT(peak(all), 0.9);
  EXPECT_EQ(all.back().force, 0);
}
INSTANTIATE_TEST_SUITE_P(Deeds, DriverEnds,
                         testing::Values(std::pair{"lost", 0}, std::pair{"caught", 3},
                                         std::pair{"uncaught", -SIGABRT},
                                         std::pair{"terminate_elsewhere", -SIGABRT},
                                         std::pair{"abort", -SIGABRT}, std::pair{"abort_elsewhere", -SIGABRT},
                                         std::pair{"fault", -SIGSEGV}, std::pair{"exit", 0},
                                         std::pair{"exit_elsewhere", 0}, std::pair{"signal", 0}),
                         [](const auto& test) { return std::string(test.param.first); });

// Whoever looks for its reason finds the crash, not the second that it was given.
TEST_F(DriverLimits, ACrashWhoseLastWriteHangsEndsByItsOwnSignal) {
  const FakeDaemon daemon(id_, 100);
  EXPECT_EQ(start("abort_held")->wait(20'000), -SIGABRT);
}

// The last force stands for 10 ms at most, and as much as the machine makes a slot late.
TEST_F(DriverLimits, ASilentDaemonIsZeroWithinTenMilliseconds) {
  auto daemon = std::make_unique<FakeDaemon>(id_, 100);
  const auto driver = start();
  ASSERT_TRUE(await([](const Written& w) { return w.force > 0.95; }));
  pause(300);
  daemon.reset();
  const std::int64_t silent = monotonic_ns();
  ASSERT_TRUE(await([](const Written& w) { return w.force == 0; }));
  pause(200);
  driver->signal(SIGTERM);
  EXPECT_EQ(driver->wait(5000), 0);
  const auto all = written();
  std::int64_t last = 0, late = 0;
  for (std::size_t i = 1; i < all.size(); ++i) {
    if (all[i].force > 0) last = all[i].at_ns;
    if (all[i].at_ns > silent - 20'000'000 && all[i].at_ns < silent + 50'000'000)
      late = std::max(late, all[i].at_ns - all[i - 1].at_ns - 1'000'000);
  }
  EXPECT_LT(1e-6 * static_cast<double>(last - silent), 9.5 + 1e-6 * static_cast<double>(late));
  // A machine that is held up makes more silences than one.
  int silences = 0;
  for (std::size_t i = 1; i < all.size(); ++i)
    silences += all[i].status == status_disarmed && all[i].force == 0 && all[i - 1].force > 0;
  EXPECT_GE(silences, 1);
  expect_limits(all, silences);
}

// The second's spring is ten times as stiff. Neither is felt from then on, not when it has gone either: this
// device's reading never lets go.
TEST_F(DriverLimits, ASecondDaemonIsZeroAtTheSlewLimitAndStaysSo) {
  const FakeDaemon daemon(id_, 100);
  const auto driver = start();
  ASSERT_TRUE(await([](const Written& w) { return w.force > 0.95; }));
  {
    const Participant other(daemon.domain());
    Writer<hapticd_msg_ForceCommand> second(other);
    hapticd_msg_ForceCommand f{};
    f.force[2] = 3;
    for (int i = 0; i < 1500; ++i) {
      second.write(f);
      pause(1);
    }
  }
  pause(1000);
  const auto all = written();
  EXPECT_LT(peak(all), 1.001);
  expect_limits(all);
  EXPECT_EQ(all.back().force, 0);
  EXPECT_TRUE(all.back().status & status_rival);
  // 1 N at 0.2 N a millisecond, and what the machine made a slot late: one that is early after it falls less.
  std::int64_t told = 0, fell = 0, late = 0;
  for (std::size_t i = 1; i < all.size(); ++i) {
    if (told == 0 && !(all[i].status & status_rival)) continue;
    if (told == 0) told = all[i].at_ns;
    if (all[i].force == 0) break;
    fell = all[i].at_ns - told;
    late = std::max(late, all[i].at_ns - all[i - 1].at_ns - 1'000'000);
  }
  EXPECT_GT(told, 0);
  EXPECT_LE(1e-6 * static_cast<double>(fell), 5.0 + 2e-6 * static_cast<double>(late));
  driver->signal(SIGTERM);
  EXPECT_EQ(driver->wait(5000), 0);
}

}  // namespace
}  // namespace hapticd
