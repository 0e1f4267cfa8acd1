// The daemon and a client as real processes over real DDS: what a dying client and a signal do.
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <unistd.h>

#include "haptic/clock.h"
#include "haptic/device.h"
#include "server/dds/dds.h"
#include "tests/support/process.h"

namespace hapticd {
namespace {

constexpr std::int64_t ms = 1'000'000;

class DaemonProcess : public testing::Test {
 protected:
  DaemonProcess()
      : domain_id_(static_cast<std::uint32_t>(100 + getpid() % 100)),
        domain_(domain_id_, read_dds_profile("loopback")),
        participant_(domain_),
        forces_(participant_),
        pressed_(std::filesystem::temp_directory_path() / ("pressed" + std::to_string(getpid()) + ".csv")) {
    // In the cube scene's device frame = scene: a 3 mm ball pressed 1.5 mm into the top at z = 20 mm.
    std::ofstream(pressed_) << "t,px,py,pz,qx,qy,qz,qw\n"
                               "0,0,0,0.0300,0,0,0,1\n0.3,0,0,0.0260,0,0,0,1\n0.6,0,0,0.0215,0,0,0,1\n"
                               "0.9,0,0,0.0215,0,0,0,1\n20,0,0,0.0215,0,0,0,1\n";
  }
  ~DaemonProcess() override { std::filesystem::remove(pressed_); }

  std::vector<std::string> daemon_command() const {
    return {BIN_DIR "/hapticd", SOURCE_DIR "/config/scenes/cube/cube.yaml", "--domain",
            std::to_string(domain_id_)};
  }
  std::vector<std::string> client_command() const {
    return {BIN_DIR "/haptic",
            "replay",
            pressed_.string(),
            "--from-scene",
            SOURCE_DIR "/config/scenes/cube/cube.yaml",
            "--domain",
            std::to_string(domain_id_)};
  }

  // Newest force until `done` says so; false after the time is over.
  bool await_force(std::int64_t timeout, const std::function<bool(const hapticd_msg_ForceCommand&)>& done) {
    const std::int64_t end = monotonic_ns() + timeout;
    while (monotonic_ns() < end) {
      bool is_done = false;
      forces_.take_each(
          [&](const hapticd_msg_ForceCommand& f, const dds_sample_info_t&) { is_done = done(f); });
      if (is_done) return true;
      usleep(200);
    }
    return false;
  }
  static double magnitude(const hapticd_msg_ForceCommand& f) {
    return std::hypot(f.force[0], f.force[1], f.force[2]);
  }

  std::uint32_t domain_id_;
  Domain domain_;
  Participant participant_;
  Reader<hapticd_msg_ForceCommand> forces_;
  std::filesystem::path pressed_;
};

TEST_F(DaemonProcess, AKilledClientsForceEndsAndANewClientArmsAgain) {
  ChildProcess daemon(daemon_command());
  for (int life = 0; life < 2; ++life) {
    ChildProcess client(client_command());
    ASSERT_TRUE(await_force(15'000 * ms, [](const auto& f) { return f.status == 0 && magnitude(f) > 0.02; }))
        << "life " << life << ": never in contact";
    client.signal(SIGKILL);
    // Five ticks of ramp from a state of 10 ms on, however late the machine makes them.
    std::uint64_t ramps = 0, ends = 0;
    ASSERT_TRUE(await_force(15'000 * ms, [&](const auto& f) {
      if (f.state_age_us < 10'000)
        ramps = 0;
      else if (ramps == 0)
        ramps = f.number;
      ends = f.number;
      return magnitude(f) == 0;
    }));
    EXPECT_TRUE(ramps == 0 || ends - ramps <= 6) << ends - ramps;
    ASSERT_TRUE(await_force(15'000 * ms, [](const auto& f) { return (f.status & status_disarmed) != 0; }));
    bool stays_zero = true;
    await_force(200 * ms, [&](const auto& f) { return !(stays_zero = stays_zero && magnitude(f) == 0); });
    EXPECT_TRUE(stays_zero);
  }
}

TEST_F(DaemonProcess, SigtermEndsItCleanlyWithinASecondEvenInContact) {
  ChildProcess daemon(daemon_command());
  ChildProcess client(client_command());
  ASSERT_TRUE(await_force(15'000 * ms, [](const auto& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  const std::int64_t asked = monotonic_ns();
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(15'000), 0);
  EXPECT_LT(monotonic_ns() - asked, 1000 * ms);
}

}  // namespace
}  // namespace hapticd
