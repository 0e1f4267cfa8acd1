// Both halves of a daemon with keys, at a station: who has the role is served, who has not hears nothing.
#include <nlohmann/json.hpp>
#include <thread>

#include <gtest/gtest.h>

#include "server/files/paths.h"
#include "tests/tools/fake_daemon.h"
#include "tests/tools/secure_keys.h"
#include "tools/cli/child.h"

namespace hapticd {
namespace {

const std::string cube = SOURCE_DIR "/config/scenes/cube/cube.yaml";
const std::string press = SOURCE_DIR "/config/scenes/cube/press.csv";

class SecureEdge : public testing::Test {
 protected:
  void SetUp() override {
    if (std::string(DDS_PLUGINS).empty()) GTEST_SKIP() << "no DDS Security plugins here";
  }
  std::unique_ptr<Child> run(const std::string& log, std::vector<std::string> command) {
    return std::make_unique<Child>(
        ChildSettings{.command = std::move(command), .output = scratch_.file(log)});
  }
  std::unique_ptr<Child> simulation() {
    return run("simulation", {BIN_DIR "/hapticd", cube, "--no-haptics", "--domain", domain_, "--station",
                              "lab1", "--secure", secure_keys(), "--log", "json"});
  }
  std::unique_ptr<Child> edge(const std::string& keys) {
    return run("edge", {BIN_DIR "/haptic", "--station", "lab1", "edge", cube, "--domain", domain_,
                        "--simulation-domain", domain_, "--secure", keys, "--log", "json"});
  }
  CommandResult replay(const std::string& options) {
    return run_haptic("--station lab1 replay " + press + " --domain " + domain_ + " --min-answered " +
                      std::to_string(answered_share()) + " --force --json " + scratch_.file("replay.json") +
                      " " + options);
  }
  std::string log(const std::string& name) const { return read_bytes(scratch_.file(name)); }

  const std::string domain_ = std::to_string(test_domain());
  ScratchDirectory scratch_;
};

TEST_F(SecureEdge, AHandWithKeysFeelsTheTissueOfAnotherProcess) {
  auto half = simulation();
  auto hand = edge(secure_keys());
  const CommandResult r = replay("--arm-wait 20 --secure " + secure_keys());
  ASSERT_EQ(r.code, 0) << r.output << log("edge") << log("simulation");
  const nlohmann::json figures = nlohmann::json::parse(log("replay.json"));
  EXPECT_GT(figures["force_peak_n"].get<double>(), 0.05) << r.output;

  // A viewer's keys show the station; without keys nobody is there, and no hand is answered.
  const CommandResult seen =
      run_haptic("fleet --once --wait 3 --domain " + domain_ + " --secure " + secure_keys());
  EXPECT_EQ(seen.code, 0) << seen.output;
  EXPECT_NE(seen.output.find("lab1"), std::string::npos) << seen.output;
  EXPECT_EQ(seen.output.find("slow"), std::string::npos)
      << seen.output;  // the simulation is elsewhere, not slow
  EXPECT_EQ(run_haptic("fleet --once --wait 1.5 --domain " + domain_).code, 1);
  EXPECT_EQ(replay("--arm-wait 2 --wait 2").code, 1);
}

TEST_F(SecureEdge, KeysOfAnotherAuthorityBringNoProblem) {
  auto half = simulation();
  auto hand = edge(secure_keys("other"));
  EXPECT_EQ(replay("--arm-wait 4 --wait 4 --secure " + secure_keys("other")).code, 1) << log("edge");
  EXPECT_NE(log("simulation").find("\"event\":\"ready\""), std::string::npos) << log("simulation");
}

}  // namespace
}  // namespace hapticd
