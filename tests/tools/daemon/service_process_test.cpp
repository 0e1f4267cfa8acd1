// The daemon as a service: what its manager hears, and what a reload does to a force that is being felt.
#include <fcntl.h>
#include <sched.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <sstream>
#include <thread>

#include <gtest/gtest.h>

#include "haptic/clock.h"
#include "haptic/loop.h"
#include "server/dds/dds.h"
#include "server/observe/log.h"
#include "server/os/realtime.h"
#include "tests/support/process.h"
#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;
constexpr std::int64_t ms = 1'000'000;

class ServiceDaemon : public testing::Test {
 protected:
  ServiceDaemon()
      : socket_(socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)), address_(scratch_.file("notify")) {
    sockaddr_un a{};
    a.sun_family = AF_UNIX;
    std::memcpy(a.sun_path, address_.data(), address_.size());
    EXPECT_EQ(bind(socket_, reinterpret_cast<sockaddr*>(&a), sizeof a), 0);
    fs::copy(SOURCE_DIR "/config/scenes/cube", scene_.parent_path());
  }
  ~ServiceDaemon() override { close(socket_); }

  // The manager's environment is put before the command, as env(1) does.
  std::vector<std::string> command(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words = {"/usr/bin/env",         "NOTIFY_SOCKET=" + address_,
                                      "WATCHDOG_USEC=400000", BIN_DIR "/hapticd",
                                      scene_.string(),        "--domain",
                                      std::to_string(domain_)};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }

  // Collects what is said for that long, or until `end` is in it.
  std::string hear(std::int64_t time, const std::string& end = "nothing ends it") {
    std::string heard;
    for (const std::int64_t until = monotonic_ns() + time; monotonic_ns() < until; usleep(2000)) {
      char text[512];
      for (ssize_t n; (n = recv(socket_, text, sizeof text, 0)) > 0;)
        heard += std::string(text, static_cast<std::size_t>(n)) + "\n";
      if (heard.find(end) != std::string::npos) break;
    }
    return heard;
  }
  static int count(const std::string& text, const std::string& what) {
    int n = 0;
    for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; ++at) ++n;
    return n;
  }
  static std::string text_of(const std::string& file) {
    std::ifstream in(file);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  void change(const std::string& from, const std::string& to) {
    std::string text = text_of(scene_.string());
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos);
    std::ofstream(scene_) << text.replace(at, from.size(), to);
  }

  const std::uint32_t domain_ = static_cast<std::uint32_t>(100 + getpid() % 100);
  ScratchDirectory scratch_;
  const int socket_;
  const std::string address_;
  const fs::path scene_ = fs::path(scratch_.file("cube")) / "cube.yaml";
};

int thread_named(int process, const std::string& name) {
  for (const auto& task : fs::directory_iterator("/proc/" + std::to_string(process) + "/task")) {
    std::ifstream in(task.path() / "comm");
    std::string comm;
    if (in >> comm && comm == name) return std::stoi(task.path().filename());
  }
  return 0;
}

// Else an ordinary program that puts it aside while it holds a lock of Cyclone's stops the haptic loop.
TEST_F(ServiceDaemon, WhoCallsCycloneBesideTheHapticLoopRunsInRealTime) {
  if (!realtime_allowed()) GTEST_SKIP() << "SCHED_FIFO is not permitted";
  ChildProcess daemon(command(), scratch_.file("log"));
  hear(20'000 * ms, "READY=1");
  for (const char* name : {"diagnostics", "gc", "dq.builtins"}) {
    int thread = 0;
    for (int turn = 0; turn < 500 && (thread = thread_named(daemon.pid(), name)) == 0; ++turn)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    ASSERT_NE(thread, 0) << name;
    // READY=1 may be sent before a thread that has its name has its class.
    for (int turn = 0; turn < 500 && sched_getscheduler(thread) != SCHED_FIFO; ++turn)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    sched_param param{};
    sched_getparam(thread, &param);
    EXPECT_EQ(sched_getscheduler(thread), SCHED_FIFO) << name;
    EXPECT_EQ(param.sched_priority, dds_priority) << name;
  }
}

TEST_F(ServiceDaemon, ItIsReadyPingsReloadsAndSaysThatItStops) {
  const std::string log = scratch_.file("log");
  ChildProcess daemon(command(), log);
  const std::string ready = hear(20'000 * ms, "READY=1");
  ASSERT_NE(ready.find("READY=1\nSTATUS=ready, domain " + std::to_string(domain_)), std::string::npos)
      << text_of(log);
  EXPECT_EQ(count(ready, "WATCHDOG=1"), 0) << "not before it serves";
  // Every 200 ms of a watchdog of 400; a busy machine may be late, never silent.
  EXPECT_GE(count(hear(2'000 * ms), "WATCHDOG=1"), 5);

  change("force_scale: 1", "force_scale: 0.5");
  change("rate: 50", "rate: 60");
  daemon.signal(SIGHUP);
  const std::string reloaded = hear(10'000 * ms, "STATUS=reloaded");
  EXPECT_LT(reloaded.find("RELOADING=1\nMONOTONIC_USEC="), reloaded.find("READY=1")) << reloaded;
  change("force_scale: 0.5", "force_scale: plenty");
  daemon.signal(SIGHUP);
  EXPECT_NE(hear(10'000 * ms, "nothing changed").find("STATUS=reload failed"), std::string::npos);

  daemon.signal(SIGTERM);
  EXPECT_NE(hear(10'000 * ms, "STOPPING=1").find("STOPPING=1"), std::string::npos);
  EXPECT_EQ(daemon.wait(10'000), 0);
  // Not a terminal: every line is an object, and says what was taken and what is anew.
  std::istringstream lines(text_of(log));
  std::string events;
  for (std::string line; std::getline(lines, line);) {
    ASSERT_TRUE(LogFields::accept(line)) << line;
    events += LogFields::parse(line)["message"].get<std::string>() + "\n";
  }
  EXPECT_NE(events.find("taken: device 0: force_scale 1 → 0.5"), std::string::npos) << events;
  EXPECT_NE(events.find("the simulation begins again with: simulation.rate"), std::string::npos) << events;
  EXPECT_NE(events.find("mapping.force_scale: 'plenty' is not a number"), std::string::npos) << events;
}

TEST_F(ServiceDaemon, IsNotPingedForWhileEitherLoopIsHeld) {
  const std::string log = scratch_.file("log");
  ChildProcess daemon(command({"--test-hooks"}), log);
  ASSERT_NE(hear(20'000 * ms, "READY=1").find("READY=1"), std::string::npos) << text_of(log);
  EXPECT_GE(count(hear(1'000 * ms), "WATCHDOG=1"), 2);
  const int pid = daemon.pid();  // of env(1) and, by its exec, of the daemon

  sigval held{};
  held.sival_int = 1500;
  ASSERT_EQ(sigqueue(pid, SIGRTMIN, held), 0);
  hear(300 * ms);  // the step under way, and the ping that it still earns
  EXPECT_EQ(count(hear(1'000 * ms), "WATCHDOG=1"), 0) << "the simulation is held";
  EXPECT_GE(count(hear(1'500 * ms), "WATCHDOG=1"), 2) << "it goes on";

  const int haptic = thread_named(pid, "haptic");
  ASSERT_GT(haptic, 0);
  ASSERT_EQ(syscall(SYS_tgkill, pid, haptic, SIGUSR2), 0);
  hear(300 * ms);
  EXPECT_EQ(count(hear(1'000 * ms), "WATCHDOG=1"), 0) << "the haptic loop is held";
  EXPECT_GE(count(hear(1'500 * ms), "WATCHDOG=1"), 2) << "it goes on";
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(10'000), 0);
}

// A signal that came while the main thread was busy with the one before reached OpenBLAS's threads, older
// than main, that blocked nothing, and ended the process.
TEST_F(ServiceDaemon, AStormOfSignalsEndsNothing) {
  ChildProcess daemon(command());
  ASSERT_NE(hear(20'000 * ms, "READY=1").find("READY=1"), std::string::npos);
  for (int i = 0; i < 100; ++i) {
    daemon.signal(SIGHUP);
    usleep(2000);
  }
  EXPECT_GE(count(hear(2'000 * ms), "WATCHDOG=1"), 1);
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(10'000), 0);
}

// Started from a terminal that is then closed: it does not live on unseen.
TEST_F(ServiceDaemon, EndsWithItsTerminal) {
  const int terminal = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (terminal < 0) GTEST_SKIP() << "no pseudo terminals here";
  ASSERT_EQ(grantpt(terminal), 0);
  ASSERT_EQ(unlockpt(terminal), 0);
  const std::string name = ptsname(terminal);
  const std::vector<std::string> daemon = command();
  std::string line = "exec setsid -c";
  for (const std::string& word : daemon) line += " '" + word + "'";
  // setsid -c makes its standard input, the terminal, the controlling one.
  ChildProcess process({"/bin/sh", "-c", line + " <" + name});
  ASSERT_NE(hear(20'000 * ms, "READY=1").find("READY=1"), std::string::npos);
  close(terminal);
  EXPECT_NE(hear(10'000 * ms, "STOPPING=1").find("STOPPING=1"), std::string::npos);
  EXPECT_EQ(process.wait(10'000), 0);
}

// Pressed 1.5 mm into the cube by a client that holds still: half the force scale is half the force, and
// between two consecutive ticks nothing changes by more than the ramp's thousandth (and the cube's own
// settling).
TEST_F(ServiceDaemon, AReloadedScaleIsFeltWithoutAStep) {
  // Down in 0.9 s, then still; sampled densely, since a recording is interpolated smoothly.
  std::string recording = "t,px,py,pz\n";
  for (int i = 0; i <= 400; ++i)
    recording += std::to_string(0.05 * i) + ",0,0," +
                 std::to_string(0.030 - 0.0085 * std::min(1.0, 0.05 * i / 0.9)) + "\n";
  const std::string held = scratch_.file("held.csv", recording);
  Domain domain(domain_, read_dds_profile("loopback"));
  Participant participant(domain);
  Reader<hapticd_msg_ForceCommand> forces(participant);
  ChildProcess daemon(command());
  ASSERT_NE(hear(20'000 * ms, "READY=1").find("READY=1"), std::string::npos);
  double newest = 0, largest = 0;
  std::uint64_t number = 0;
  const auto watch = [&](std::int64_t time) {
    for (const std::int64_t until = monotonic_ns() + time; monotonic_ns() < until; usleep(100))
      forces.take_each([&](const hapticd_msg_ForceCommand& f, const dds_sample_info_t&) {
        const double force = std::hypot(f.force[0], f.force[1], f.force[2]);
        if (f.number == number + 1 && f.status == 0) largest = std::max(largest, std::abs(force - newest));
        number = f.number;
        newest = force;
      });
  };
  // A machine that stood still for 100 ms has let the device go: then the client begins again.
  std::optional<ChildProcess> client;
  for (int attempt = 0; attempt < 3 && newest < 0.02; ++attempt) {
    client.reset();
    client.emplace(std::vector<std::string>{BIN_DIR "/haptic", "replay", held, "--from-scene",
                                            scene_.string(), "--domain", std::to_string(domain_)});
    for (int i = 0; i < 80 && newest < 0.02; ++i) watch(100 * ms);
    watch(1'500 * ms);
  }
  const double before = newest;
  ASSERT_GT(before, 0.02) << "never in contact";
  largest = 0;
  change("force_scale: 1", "force_scale: 0.5");
  daemon.signal(SIGHUP);
  watch(2'500 * ms);
  EXPECT_NEAR(newest, before / 2, 0.03 * before);
  EXPECT_LT(largest, 0.02 * before) << "a step of " << largest << " N of " << before;
  std::printf("force %.4f to %.4f N, largest change between two ticks %.6f N\n", before, newest, largest);
}

}  // namespace
}  // namespace hapticd
