// The command line's promises: 2 and a named cause for wrong usage or input, 1 for what could not be done.
#include <gtest/gtest.h>

#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

void expect_refused(const std::string& arguments, const std::vector<std::string>& named) {
  const CommandResult result = run_haptic(arguments);
  EXPECT_EQ(result.code, 2) << arguments << "\n" << result.output;
  for (const std::string& part : named)
    EXPECT_NE(result.output.find(part), std::string::npos) << part << " in\n" << result.output;
}

TEST(Command, HelpHasAnExample) {
  for (const char* command : {"", "replay", "hand", "chart", "chart removal", "mesh", "doctor", "view"}) {
    const CommandResult result = run_haptic(std::string(command) + " --help");
    EXPECT_EQ(result.code, 0);
    EXPECT_NE(result.output.find("Example: haptic "), std::string::npos) << result.output;
  }
}

TEST(Command, WrongUsageIsTwo) {
  expect_refused("", {"subcommand"});
  expect_refused("fly", {});
  expect_refused("replay", {"FILE"});
  expect_refused("replay a.csv --units inch", {"--units"});
  expect_refused("replay a.csv --speed 0", {"--speed"});
  expect_refused("replay a.csv --domain 999", {"--domain"});
  expect_refused("hand --mass 0", {"mass"});
  expect_refused("hand --press 0.01,0", {"--press"});
  expect_refused("hand --direction 0,0,0", {"--direction"});
  expect_refused("hand --press 0.01 --target a.csv", {"--target"});
}

TEST(Command, AFaultyRecordingIsTwoAndNamedByFileLineAndColumn) {
  const ScratchDirectory scratch;
  expect_refused("replay " + scratch.file("missing.csv"), {"missing.csv"});
  expect_refused("hand --target " + scratch.file("missing.csv"), {"missing.csv"});
  expect_refused("hand --device " + scratch.file("missing.yaml"), {"missing.yaml"});
  expect_refused("replay x.csv --from-scene " + scratch.file("missing.yaml"), {"missing.yaml"});
  const std::string column = scratch.file("column.csv", "t,px,py,pq\n0,0,0,0\n1,0,0,0\n");
  expect_refused("replay " + column, {"column.csv:1", "pq"});
  const std::string number = scratch.file("number.csv", "t,px,py,pz\n0,0,0,0\n1,zero,0,0\n");
  expect_refused("replay " + number, {"number.csv:3", "px"});
}

TEST(Command, WithoutADaemonItIsOneAndSaysHowToStartOne) {
  const ScratchDirectory scratch;
  const std::string file = scratch.file("still.csv", "t,px,py,pz\n0,0,0,0\n0.1,0,0,0\n");
  const CommandResult result = run_haptic("replay " + file + " --domain 39 --wait 0.5");
  EXPECT_EQ(result.code, 1) << result.output;
  EXPECT_NE(result.output.find("no daemon answered in DDS domain 39 with the profile "), std::string::npos)
      << result.output;
  EXPECT_NE(result.output.find("/dds/loopback"), std::string::npos) << result.output;
  EXPECT_NE(result.output.find("hapticd SCENE.yaml"), std::string::npos) << result.output;
}

}  // namespace
}  // namespace hapticd
