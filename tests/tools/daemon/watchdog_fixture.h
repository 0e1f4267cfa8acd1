// hapticd as a process with the cube scene and its test hooks, and a client that can lie, fall silent and
// flood.
#pragma once

#include <chrono>
#include <cmath>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "haptic/device.h"
#include "tests/tools/fake_daemon.h"
#include "tests/tools/run_command.h"
#include "tests/tools/scripted_client.h"
#include "tools/cli/child.h"

namespace hapticd::watchdog {

using Force = ScriptedClient::Force;
using State = ScriptedClient::State;

inline constexpr double free_z = 0.0300,
                        touching_z = 0.0215;      // a 3 mm ball above, and 1.5 mm into, the cube of 20 mm
inline constexpr double touch_step = 200 * 1e-3;  // config/devices/touch.yaml: N/s in a tick
inline constexpr int patience_ms = 20'000;        // until something must have come, on whatever machine

inline double magnitude(const Force& f) { return ScriptedClient::magnitude(f); }
inline bool has(const Force& f, std::uint32_t bits) { return (f.status & bits) != 0; }

// No two forces of consecutive ticks further apart than the device's slew limit, none above its maximum.
inline void expect_bounded(const std::vector<Force>& forces, double step, double maximum) {
  for (std::size_t i = 0; i < forces.size(); ++i) {
    ASSERT_TRUE(std::isfinite(magnitude(forces[i])));
    ASSERT_LE(magnitude(forces[i]), maximum * (1 + 1e-9));
    if (i == 0 || forces[i].number != forces[i - 1].number + 1) continue;
    // What ends at once is exempt: zero is always allowed.
    if (magnitude(forces[i]) == 0) continue;
    Vec3 change;
    for (int k = 0; k < 3; ++k) change[k] = forces[i].force[k] - forces[i - 1].force[k];
    ASSERT_LE(change.norm(), step * (1 + 1e-6)) << "at tick " << forces[i].number;
  }
}

// Parameter: the daemon's mode.
class Watchdog : public testing::TestWithParam<const char*> {
 protected:
  Watchdog() : domain_(test_domain(), read_dds_profile("loopback")), participant_(domain_) {}

  void start(std::vector<std::string> more = {}) {
    std::vector<std::string> command = {BIN_DIR "/hapticd", SOURCE_DIR "/config/scenes/cube/cube.yaml",
                                        "--domain",         std::to_string(domain_.id()),
                                        "--mode",           GetParam(),
                                        "--test-hooks"};
    command.insert(command.end(), more.begin(), more.end());
    daemon_.emplace(ChildSettings{.command = command, .output = log_.file("daemon.log")});
    client_.emplace(participant_);
    ASSERT_TRUE(client_->await(patience_ms, [](const Force&) { return true; })) << "no force came";
  }
  // enable false, until the daemon has seen it, and true.
  void edge() {
    client_->enable(false);
    EXPECT_TRUE(client_->await(patience_ms, [](const Force& f) { return has(f, status_disarmed); }));
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    client_->enable(true);
  }
  // Armed, and pressed into the cube.
  void touch() {
    edge();
    client_->move_to(touching_z, 300);
    ASSERT_TRUE(
        client_->await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  }
  void rearm() {
    edge();
    EXPECT_TRUE(
        client_->await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  }

  Domain domain_;
  Participant participant_;
  ScratchDirectory log_;
  std::optional<Child> daemon_;
  std::optional<ScriptedClient> client_;
};

}  // namespace hapticd::watchdog
