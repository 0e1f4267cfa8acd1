// `haptic fleet` beside daemons: whom it names, whose loss it shows, and the page in a browser.
#include <chrono>
#include <functional>
#include <nlohmann/json.hpp>
#include <thread>

#include <gtest/gtest.h>

#include "server/files/paths.h"
#include "tests/tools/fake_daemon.h"
#include "tests/tools/run_command.h"
#include "tools/cli/child.h"

namespace hapticd {
namespace {

const std::string cube = SOURCE_DIR "/config/scenes/cube/cube.yaml";

class FleetDaemon : public testing::Test {
 protected:
  std::unique_ptr<Child> run(const std::string& log, std::vector<std::string> command) {
    return std::make_unique<Child>(
        ChildSettings{.command = std::move(command), .output = scratch_.file(log)});
  }
  std::unique_ptr<Child> daemon(const std::string& station) {
    std::vector<std::string> command = {BIN_DIR "/hapticd", cube, "--domain", domain_};
    if (!station.empty()) command.insert(command.end(), {"--station", station});
    return run("daemon" + station, command);
  }
  // A line of `haptic fleet` that is no terminal: "NAME  state…". Returns whether it came, and when it was
  // seen.
  bool says(const std::string& line, double seconds) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (std::chrono::steady_clock::now() < until) {
      if (read_bytes(scratch_.file("fleet")).find(line) != std::string::npos) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return false;
  }

  const std::string domain_ = std::to_string(test_domain());
  ScratchDirectory scratch_;
};

TEST_F(FleetDaemon, StationsOfOneDeviceAreNamedAndALossIsShownWithinASecond) {
  auto fleet =
      run("fleet", {BIN_DIR "/haptic", "fleet", "--domain", domain_, "--json", scratch_.file("fleet.json")});
  auto a = daemon("lab.a"), b = daemon("lab.b"), nameless = daemon("");
  EXPECT_TRUE(says("lab.a  idle", 20)) << read_bytes(scratch_.file("daemonlab.a"));
  EXPECT_TRUE(says("lab.b  idle", 20));
  EXPECT_TRUE(says("(no name)  idle", 20));
  std::this_thread::sleep_for(std::chrono::milliseconds(2500));
  a->signal(SIGKILL);
  EXPECT_TRUE(says("lab.a  lost", 1.0 + 0.2)) << read_bytes(scratch_.file("fleet"));  // 0.2: this test's own
  b->signal(SIGTERM);
  EXPECT_TRUE(says("lab.b  ended", 10)) << read_bytes(scratch_.file("fleet"));
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  const nlohmann::json j = nlohmann::json::parse(read_bytes(scratch_.file("fleet.json")));
  ASSERT_EQ(j["stations"].size(), 3u);
  EXPECT_EQ(j["stations"][0]["station"], "");
  EXPECT_EQ(j["stations"][0]["state"], "idle");
  EXPECT_EQ(j["stations"][1]["state"], "lost");
  for (const nlohmann::json& station : j["stations"]) {
    ASSERT_EQ(station["devices"].size(), 1u);
    EXPECT_EQ(station["scene"], "cube");
    EXPECT_EQ(station["devices"][0]["id"], 0);
    EXPECT_EQ(station["devices"][0]["device"], "Touch");
    EXPECT_NEAR(station["devices"][0]["max_force_n"].get<double>(), 3.3, 1e-6);
    EXPECT_EQ(station["operation"][0]["bodies"][0]["name"], "cube");
    EXPECT_NE(station["host"], "");
  }
}

TEST_F(FleetDaemon, OnceEndsWithOneWhereNobodyIs) {
  EXPECT_EQ(run_haptic("fleet --once --wait 0.5 --domain " + domain_).code, 1);
  auto a = daemon("lab.a"), b = daemon("lab.b");
  CommandResult r;
  for (int i = 0; i < 10 && r.output.find("lab.a") == std::string::npos; ++i)
    r = run_haptic("--station lab.a fleet --once --domain " + domain_);
  EXPECT_EQ(r.code, 0) << r.output;
  EXPECT_NE(r.output.find("1 station, 1 idle"), std::string::npos) << r.output;  // the other is not heard
}

TEST_F(FleetDaemon, TheBrowserShowsTilesAndOpensAView) {
  const CommandResult r = run_command(
      "/usr/bin/python3 " SOURCE_DIR "/tests/tools/fleet/page_test.py " BIN_DIR " " SOURCE_DIR " " + domain_);
  if (r.code == 77) GTEST_SKIP() << r.output;
  EXPECT_EQ(r.code, 0) << r.output;
}

TEST(FleetCommand, UsageIsChecked) {
  EXPECT_EQ(run_haptic("fleet --once --page").code, 2);
  EXPECT_EQ(run_haptic("fleet --port 1").code, 2);
  EXPECT_EQ(run_haptic("--station '*' fleet --once").code, 2);
  EXPECT_EQ(run_haptic("fleet --page --listen here --port 0").code, 2);
}

}  // namespace
}  // namespace hapticd
