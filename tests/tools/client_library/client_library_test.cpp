// The C library from outside: its header, its symbols, and what it answers to daemons that are not there,
// die, are two, or serve somebody else.
#include "tools/client_library/haptic_client.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <functional>
#include <memory>
#include <sstream>
#include <thread>

#include <gtest/gtest.h>

#include "tests/support/process.h"
#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

const std::string library = BIN_DIR "/../lib/libhaptic_client.so.0";
const std::string folder = SOURCE_DIR "/tools/client_library";

double seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

TEST(ClientLibrary, TheHeaderIsC99AndCpp) {
  const ScratchDirectory scratch;
  const std::string user =
      scratch.file("user", "#include <haptic_client.h>\nhaptic_pose p = HAPTIC_POSE_INIT;\n");
  for (const std::string compiler : {"cc -std=c99 -x c ", "c++ -std=c++11 -x c++ "}) {
    const CommandResult result =
        run_command(compiler + user + " -Wall -Wextra -Wpedantic -Werror -fsyntax-only -I" + folder);
    EXPECT_EQ(result.code, 0) << result.output;
  }
}

TEST(ClientLibrary, ExportsItsTenFunctionsAndLinksNoSimulation) {
  std::istringstream symbols(run_command("nm -D --defined-only " + library).output);
  int functions = 0;
  for (std::string address, kind, name; symbols >> address >> kind >> name;) {
    if (kind == "A") continue;  // the version's own
    EXPECT_TRUE(name.starts_with("haptic_") && name.ends_with("@@HAPTIC_CLIENT_0")) << name;
    ++functions;
  }
  EXPECT_EQ(functions, 10);
  const std::string needed = run_command("objdump -p " + library).output;
  EXPECT_NE(needed.find("libhaptic_client.so.0"), std::string::npos);  // SONAME
  for (const char* other : {"cholmod", "blas", "fcl", "sqlite"})
    EXPECT_EQ(needed.find(other), std::string::npos);
}

// A client of its own domain's daemon.
class ClientLibraryDaemon : public testing::Test {
 protected:
  ~ClientLibraryDaemon() override { haptic_close(client_); }

  std::unique_ptr<ChildProcess> daemon() const {
    return std::make_unique<ChildProcess>(std::vector<std::string>{
        BIN_DIR "/hapticd", SOURCE_DIR "/config/scenes/cube/cube.yaml", "--domain", std::to_string(domain_)});
  }
  void open(std::uint32_t domain) {
    haptic_options options = HAPTIC_OPTIONS_INIT;
    haptic_error error = HAPTIC_ERROR_INIT;
    options.device = "touch";
    options.domain = domain;
    ASSERT_EQ(haptic_open(&options, &client_, &error), HAPTIC_OK) << error.message;
  }
  // One slot, 1.5 mm in the cube or on the way there; slower than the device's max_speed by far.
  haptic_result slot() {
    haptic_pose pose = HAPTIC_POSE_INIT;
    pose.position[2] = z_ = std::max(0.0215, z_ - 8.5e-6);
    haptic_next_slot(client_);
    return haptic_exchange(client_, &pose, &force_);
  }
  bool until(const std::function<bool()>& done, double most) {
    for (const double begun = seconds(); seconds() - begun < most;) {
      slot();
      if (done()) return true;
    }
    return false;
  }
  bool pressed() {
    return until([this] { return size() > 0.02 && force_.status == 0; }, 20);
  }
  double size() const { return std::hypot(force_.force[0], force_.force[1], force_.force[2]); }
  std::string explained() const {
    char text[512];
    haptic_explain(client_, static_cast<haptic_result>(force_.result), text, sizeof text);
    return text;
  }

  const std::uint32_t domain_ = 40 + static_cast<std::uint32_t>(getpid()) % 60;
  haptic_client* client_ = nullptr;
  haptic_force force_ = HAPTIC_FORCE_INIT;
  double z_ = 0.030;
};

// Handles of one process may be at several stations; one of the first version, without the field, is at none.
TEST_F(ClientLibraryDaemon, AStationIsHeardByItsOwnClientsAlone) {
  const ChildProcess daemon(std::vector<std::string>{BIN_DIR "/hapticd",
                                                     SOURCE_DIR "/config/scenes/cube/cube.yaml", "--domain",
                                                     std::to_string(domain_), "--station", "lab1"});
  haptic_client* nameless = nullptr;
  haptic_options options = HAPTIC_OPTIONS_INIT;
  haptic_error error = HAPTIC_ERROR_INIT;
  options.device = "touch";
  options.domain = domain_;
  options.station = "lab1";
  ASSERT_EQ(haptic_open(&options, &client_, &error), HAPTIC_OK) << error.message;
  options.size = 32;
  ASSERT_EQ(haptic_open(&options, &nameless, &error), HAPTIC_OK) << error.message;
  EXPECT_TRUE(pressed()) << explained();
  haptic_force force = HAPTIC_FORCE_INIT;
  haptic_result result = HAPTIC_OK;
  for (int i = 0; i < 400; ++i) {
    const haptic_pose pose = HAPTIC_POSE_INIT;
    haptic_next_slot(nameless);
    result = haptic_exchange(nameless, &pose, &force);
  }
  EXPECT_EQ(result, HAPTIC_NO_DAEMON);
  haptic_close(nameless);
  options.size = sizeof options;
  options.station = "lab*";
  haptic_client* any = nullptr;
  EXPECT_EQ(haptic_open(&options, &any, &error), HAPTIC_BAD_ARGUMENT);
  EXPECT_NE(std::string(error.message).find("'lab*' is no name"), std::string::npos) << error.message;
}

TEST_F(ClientLibraryDaemon, WhatIsWrongIsSaidByValue) {
  haptic_options options = HAPTIC_OPTIONS_INIT;
  haptic_error error = HAPTIC_ERROR_INIT;
  const auto opened = [&] { return haptic_open(&options, &client_, &error); };
  EXPECT_EQ(haptic_open(nullptr, &client_, &error), HAPTIC_BAD_ARGUMENT);
  EXPECT_EQ(opened(), HAPTIC_BAD_ARGUMENT);  // whose limits?
  EXPECT_NE(std::string(error.message).find("no device is named"), std::string::npos);
  options.device = "tuch";
  EXPECT_EQ(opened(), HAPTIC_BAD_DEVICE);
  EXPECT_NE(std::string(error.file).find("devices/tuch.yaml"), std::string::npos);
  const ScratchDirectory scratch;
  const std::string mine = scratch.file("mine.yaml", "device: mine\nmax_force: .inf\n");
  options.device = mine.c_str();
  EXPECT_EQ(opened(), HAPTIC_BAD_DEVICE);
  EXPECT_EQ(std::string(error.key), "max_force");
  EXPECT_EQ(error.line, 2);
  options.device = "touch";
  options.keys = "/nowhere";
  EXPECT_EQ(opened(), HAPTIC_BAD_DEVICE);
  EXPECT_EQ(std::string(error.file), "/nowhere");
  options.size = 4;
  EXPECT_EQ(opened(), HAPTIC_BAD_ARGUMENT);
  EXPECT_EQ(client_, nullptr);
  EXPECT_EQ(haptic_exchange(nullptr, nullptr, &force_), HAPTIC_BAD_ARGUMENT);
  EXPECT_EQ(haptic_close(nullptr), HAPTIC_OK);

  open(domain_);
  for (const double bad : {std::nan(""), 2.0}) {
    haptic_pose pose = HAPTIC_POSE_INIT;
    (bad > 0 ? pose.orientation[0] : pose.position[1]) = bad;
    EXPECT_EQ(haptic_exchange(client_, &pose, &force_), HAPTIC_BAD_POSE);
    EXPECT_EQ(size(), 0);
  }
}

TEST_F(ClientLibraryDaemon, AWrongDomainIsAnErrorWithin200MsThatNamesIt) {
  const auto elsewhere = daemon();
  open(domain_ + 1);
  const double begun = seconds();
  EXPECT_TRUE(until([this] { return force_.result < 0; }, 1));
  EXPECT_LT(seconds() - begun, 0.2);
  EXPECT_EQ(force_.result, HAPTIC_NO_DAEMON);
  EXPECT_EQ(size(), 0);
  EXPECT_NE(explained().find("DDS domain " + std::to_string(domain_ + 1)), std::string::npos) << explained();
  EXPECT_NE(explained().find("loopback"), std::string::npos) << explained();
}

TEST_F(ClientLibraryDaemon, ADeadDaemonIsZeroAndAnErrorWithin200MsAndALiveOneIsFeltAgain) {
  auto first = daemon();
  open(domain_);
  ASSERT_TRUE(pressed());
  first->signal(SIGKILL);
  const double killed = seconds();
  EXPECT_TRUE(until([this] { return force_.result < 0; }, 1));
  EXPECT_EQ(force_.result, HAPTIC_SILENT);
  EXPECT_LT(seconds() - killed, 0.2);
  EXPECT_EQ(size(), 0);
  const auto second = daemon();
  EXPECT_TRUE(pressed());
  EXPECT_EQ(force_.result, HAPTIC_OK);
}

TEST_F(ClientLibraryDaemon, ASecondThreadIsToldAndTheFirstDoesNotNotice) {
  const auto one = daemon();
  open(domain_);
  ASSERT_TRUE(pressed());
  // Other work of the machine may hold this thread up; a trial with a pause of a client's silence tells
  // nothing.
  constexpr int trials = 20;
  double pause = 1;
  for (int trial = 0; trial < trials && pause > 0.005; ++trial) {
    ASSERT_TRUE(pressed());
    std::atomic<bool> over{false};
    int refused = 0, through = 0;
    double written = 0;
    std::thread second([&] {
      haptic_pose pose = HAPTIC_POSE_INIT;
      haptic_force force = HAPTIC_FORCE_INIT;
      while (!over) {
        for (int call = 0; call < 200; ++call) {  // some while the first one is at its own
          force.force[2] = 1;
          (haptic_exchange(client_, &pose, &force) == HAPTIC_WRONG_THREAD ? refused : through) += 1;
          written = std::max(written, std::abs(force.force[2]));
        }
        std::this_thread::sleep_for(std::chrono::microseconds(700));
      }
    });
    pause = 0;
    double before = seconds();
    bool wrong = false;
    double weakest = 1;
    until(
        [&] {
          pause = std::max(pause, seconds() - before);
          before = seconds();
          wrong = wrong || force_.result == HAPTIC_WRONG_THREAD;
          if (force_.result == HAPTIC_OK && force_.status == 0) weakest = std::min(weakest, size());
          return false;
        },
        0.3);
    over = true;
    second.join();
    if (pause > 0.005) continue;
    EXPECT_FALSE(wrong);
    EXPECT_GE(weakest, 0.01);  // 0.02 and more when pressed …
    EXPECT_LT(weakest, 1);     // … and some were
    EXPECT_GT(refused, 100);
    EXPECT_EQ(through, 0);
    EXPECT_EQ(written, 0);
  }
  if (pause > 0.005) GTEST_SKIP() << "the machine held this thread up in each of " << trials << " trials";
}

TEST_F(ClientLibraryDaemon, ASecondDaemonIsZeroAndTold) {
  const auto first = daemon();
  open(domain_);
  ASSERT_TRUE(pressed());
  const auto second = daemon();
  EXPECT_TRUE(until([this] { return force_.result == HAPTIC_SECOND_DAEMON && size() == 0; }, 10));
  EXPECT_FALSE(until([this] { return size() > 0; }, 1));
}

TEST_F(ClientLibraryDaemon, TheSecondClientOfADeviceIsTold) {
  const auto one = daemon();
  open(domain_);
  ASSERT_TRUE(pressed());
  const ScratchDirectory scratch;
  const std::string output = scratch.file("second");
  ChildProcess second({BIN_DIR "/haptic_press", std::to_string(domain_)}, output);
  int slots = 0;
  until(
      [&] {
        if (++slots % 50 == 0) second.wait(1);
        return second.pid() == 0;
      },
      40);
  const std::string said = run_command("cat " + output).output;
  EXPECT_NE(said.find(" 0 answered, peak force 0.0000 N: the daemon serves another client"),
            std::string::npos)
      << said;
}

TEST_F(ClientLibraryDaemon, TwoDevicesShareADomainAndEndApart) {
  open(domain_);
  haptic_client* const first = client_;
  open(domain_);
  EXPECT_EQ(haptic_close(first), HAPTIC_OK);
  const auto one = daemon();
  EXPECT_TRUE(pressed());
}

TEST_F(ClientLibraryDaemon, ItsOwnThreadTakesPosesAndLetsGoOfStaleOnes) {
  const auto one = daemon();
  open(domain_);
  ASSERT_EQ(haptic_start(client_, nullptr), HAPTIC_OK);
  EXPECT_EQ(haptic_start(client_, nullptr), HAPTIC_WRONG_THREAD);
  EXPECT_EQ(slot(), HAPTIC_WRONG_THREAD);
  haptic_pose pose = HAPTIC_POSE_INIT;
  for (pose.position[2] = 0.030; pose.position[2] > 0.0215; pose.position[2] -= 1e-4) {
    EXPECT_EQ(haptic_set_pose(client_, &pose), HAPTIC_OK);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_EQ(haptic_get_force(client_, &force_), HAPTIC_OK) << explained();
  EXPECT_GT(size(), 0.02);
  std::this_thread::sleep_for(std::chrono::milliseconds(400));  // nobody sets a pose
  haptic_get_force(client_, &force_);
  EXPECT_EQ(size(), 0);
  EXPECT_EQ(haptic_stop(client_), HAPTIC_OK);
  EXPECT_EQ(haptic_get_force(client_, &force_), HAPTIC_STOPPED);
}

struct Told {
  haptic_client* client = nullptr;
  double z = 0.030, newest = -1, peak = 0;
  int deed = 0, stop = 0;  // 1: the device is lost, 2: an exception
  static int read(void* self, haptic_pose* pose) {
    Told& t = *static_cast<Told*>(self);
    pose->position[2] = t.z = std::max(0.0215, t.z - 8.5e-6);
    if (t.newest < 0.02) return 0;
    if (t.stop == 0) t.stop = haptic_stop(t.client);
    if (t.deed == 2) throw 1;
    return t.deed;
  }
  static void write(void* self, const haptic_force* force) {
    Told& t = *static_cast<Told*>(self);
    t.newest = std::hypot(force->force[0], force->force[1], force->force[2]);
    t.peak = std::max(t.peak, t.newest);
  }
};

TEST_F(ClientLibraryDaemon, ACallbackThatFailsLeavesZeroBehind) {
  const auto one = daemon();
  open(domain_);
  for (const int deed : {1, 2}) {
    Told told;
    told.client = client_;
    told.deed = deed;
    haptic_callbacks callbacks = HAPTIC_CALLBACKS_INIT;
    callbacks.read = &Told::read;
    callbacks.write = &Told::write;
    callbacks.user = &told;
    ASSERT_EQ(haptic_start(client_, &callbacks), HAPTIC_OK);
    const int end = deed == 1 ? HAPTIC_STOPPED : HAPTIC_CALLBACK;
    for (int i = 0; i < 1000 && force_.result != end; ++i) {
      haptic_get_force(client_, &force_);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    EXPECT_EQ(force_.result, end);
    EXPECT_EQ(haptic_stop(client_), HAPTIC_OK);
    EXPECT_GT(told.peak, 0.02);
    EXPECT_EQ(told.newest, 0);
    EXPECT_EQ(told.stop, HAPTIC_WRONG_THREAD);  // a callback cannot stop its own thread
  }
}

// An example that presses the cube for ten seconds, as somebody with the right to SCHED_FIFO would start it.
void expect_answered(const std::string& example) {
  const CommandResult result = run_command((realtime_allowed() ? "chrt -f 50 " : "") + example);
  std::printf("%s", result.output.c_str());
  int slots = 0, answered = 0;
  double peak = 0;
  ASSERT_EQ(
      std::sscanf(result.output.c_str(), "%d slots, %d answered, peak force %lf N", &slots, &answered, &peak),
      3);
  EXPECT_EQ(result.code, 0);
  EXPECT_EQ(slots, 10000);
  EXPECT_GE(answered, 1e4 * answered_share());
  EXPECT_GT(peak, 0.02);
}

TEST_F(ClientLibraryDaemon, TheExampleInCIsAnswered) {
  const auto one = daemon();
  std::this_thread::sleep_for(std::chrono::seconds(2));
  expect_answered(BIN_DIR "/haptic_press " + std::to_string(domain_));
}

TEST_F(ClientLibraryDaemon, TheExampleInCSharpIsAnswered) {
  if (run_command("mcs --version && mono --version").code != 0) GTEST_SKIP() << "mono is not installed";
  const ScratchDirectory scratch;
  const std::string program = scratch.file("Press.exe");
  const CommandResult built = run_command("mcs -out:" + program + " " + folder + "/Press.cs");
  ASSERT_EQ(built.code, 0) << built.output;
  const auto one = daemon();
  std::this_thread::sleep_for(std::chrono::seconds(2));
  expect_answered("env LD_LIBRARY_PATH=" + library.substr(0, library.rfind('/')) + " mono " + program + " " +
                  std::to_string(domain_));
}

}  // namespace
}  // namespace hapticd
