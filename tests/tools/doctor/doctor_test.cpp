#include "tools/doctor/doctor.h"

#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include <gtest/gtest.h>

#include "server/dds/key_dates.h"
#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

TEST(Doctor, AnyFailureIsOneWarningsAreNought) {
  const Finding good{"a", Health::pass, "x", ""}, warned{"b", Health::warn, "y", "do this"},
      bad{"c", Health::fail, "z", "do that"};
  EXPECT_EQ(worst({good, warned}), Health::warn);
  EXPECT_EQ(worst({good, bad, warned}), Health::fail);
  EXPECT_EQ(to_text({good, warned, bad}),
            "pass  a  x\n"
            "warn  b  y\n"
            "         → do this\n"
            "FAIL  c  z\n"
            "         → do that\n"
            "1 pass, 1 warn, 1 fail\n");
  EXPECT_EQ(to_json({good, warned})["verdict"], "warn");
  EXPECT_EQ(to_json({good, bad})["checks"][1]["fix"], "do that");
}

TEST(Doctor, EveryMachineCheckThatDoesNotPassHasAFix) {
  const std::vector<Finding> findings = check_machine();
  EXPECT_GE(findings.size(), 8u);
  for (const Finding& f : findings) {
    EXPECT_FALSE(f.found.empty()) << f.name;
    EXPECT_EQ(f.fix.empty(), f.health == Health::pass) << f.name;
  }
}

TEST(Doctor, TheProgramUsesOneBlasThreadWhateverTheEnvironmentSays) {
  const CommandResult doctor = run_command("OPENBLAS_NUM_THREADS=2 " BIN_DIR "/haptic doctor");
#ifdef HAPTICD_OPENBLAS
  EXPECT_NE(doctor.output.find(", 1 thread\n"), std::string::npos) << doctor.output;
#endif
}

TEST(Doctor, ReadsUntilWhenPermissionsHold) {
  EXPECT_NEAR(*days_left_of_permissions(
                  "<not_before>2000-01-01T00:00:00</not_before><not_after>2000-01-02T00:00:00</not_after>"),
              -9000, 9000);
  EXPECT_LT(*days_left_of_permissions("<not_after>2000-01-02T00:00:00</not_after>"), 0);
  EXPECT_GT(*days_left_of_permissions("<not_after> 2999-01-02T00:00:00 </not_after>"), 300'000);
  EXPECT_EQ(days_left_of_permissions("nothing"), std::nullopt);
  EXPECT_EQ(days_left_of_certificate("-----BEGIN CERTIFICATE-----\nnone\n"), std::nullopt);
}

TEST(Doctor, KeysThatHaveEndedAreNamedWithWhatMakesNewOnes) {
  const ScratchDirectory scratch;
  Security security;
  security.role = "device";
  security.authority = security.certificate = scratch.file("ca.pem", "-----BEGIN CERTIFICATE-----\n");
  const auto until = [&](const std::string& date) {
    security.permissions = scratch.file("permissions.p7s", "<not_after>" + date + "</not_after>");
    return ended_keys(security);
  };
  EXPECT_EQ(until("2999-01-02T00:00:00"), "");
  const std::string said = until("2000-01-02T00:00:00");
  EXPECT_NE(said.find("the keys of device in "), std::string::npos) << said;
  EXPECT_NE(said.find("have ended: run make_keys.sh"), std::string::npos) << said;
  EXPECT_EQ(ended_keys(std::nullopt), "");
}

// Keys of ten days, one of them for everybody's eyes.
TEST(Doctor, KeysThatEndSoonWarnAndOpenKeysFail) {
  const ScratchDirectory scratch;
  const std::string keys = scratch.file("keys");
  ASSERT_EQ(run_command(SOURCE_DIR "/config/dds/security/make_keys.sh " + keys + " 10").code, 0);
  std::vector<Finding> findings = check_security(keys);
  EXPECT_EQ(worst(findings), Health::warn) << to_text(findings);
  chmod((keys + "/device/key.pem").c_str(), 0644);
  std::filesystem::remove(keys + "/viewer/cert.pem");
  findings = check_security(keys);
  const std::string text = to_text(findings);
  EXPECT_EQ(worst(findings), Health::fail);
  EXPECT_NE(text.find("device/key.pem: mode 644"), std::string::npos) << text;
  EXPECT_NE(text.find("chmod 600"), std::string::npos) << text;
  EXPECT_NE(text.find("viewer/cert.pem: no such file"), std::string::npos) << text;
  EXPECT_TRUE(text.find("ends in 9 days") != std::string::npos ||
              text.find("ends in 10 days") != std::string::npos)
      << text;
  EXPECT_EQ(worst(check_security(scratch.file("none"))), Health::fail);
}

TEST(Doctor, AFaultySceneFailsAndIsNamed) {
  const ScratchDirectory scratch;
  const std::vector<Finding> findings = check_scene(scratch.file("s.yaml", "scene: s\nfoo: 1\n"), "");
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_EQ(findings[0].health, Health::fail);
  EXPECT_NE(findings[0].found.find("s.yaml:2: foo"), std::string::npos) << findings[0].found;
}

// The whole command: a round trip between two processes, a scene's plan, figures in a file.
TEST(Doctor, RunsOnTheCubeSceneAndEndsWithoutFailure) {
  const ScratchDirectory scratch;
  const std::string json = scratch.file("doctor.json");
  const CommandResult result = run_haptic("doctor " SOURCE_DIR "/config/scenes/cube/cube.yaml --json " +
                                          json + " --domain " + std::to_string(100 + getpid() % 100));
  EXPECT_EQ(result.code, 0) << result.output;
  EXPECT_NE(result.output.find("round trips"), std::string::npos) << result.output;
  std::ifstream in(json);
  const nlohmann::json figures = nlohmann::json::parse(in);
  EXPECT_NE(figures["verdict"], "fail");
  EXPECT_GE(figures["checks"].size(), 11u);
  EXPECT_EQ(run_haptic("doctor " + scratch.file("none.yaml")).code, 1);
}

}  // namespace
}  // namespace hapticd
