// The commands against a daemon over loopback DDS, in a domain of the process's own.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/tools/fake_daemon.h"
#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

std::string domain() { return " --domain " + std::to_string(test_domain()) + " "; }

nlohmann::json read_json(const std::string& file) { return nlohmann::json::parse(std::ifstream(file)); }

// A metre scale on purpose, at 62.5 Hz: px runs from 0.080 to 0.120 m in one second, then stands.
std::string recording(const ScratchDirectory& scratch) {
  std::ostringstream csv;
  csv << "# a stylus\nt,qx,qy,qz,qw,px,py,pz,buttons\n";
  for (int i = 0; i <= 75; ++i) {
    const double t = 0.016 * i;
    csv << t << ",0,0,0,1," << 80 + 40 * std::min(t, 1.0) << ",0,0," << (t > 0.5 ? 1 : 0) << "\n";
  }
  return scratch.file("stroke.csv", csv.str());
}

TEST(Replay, PlaysARecordingAndAccountsForEverySlot) {
  const ScratchDirectory scratch;
  FakeDaemon daemon(test_domain(), 10, 3);
  const CommandResult result =
      run_haptic("replay " + recording(scratch) + " --units mm " + domain() +
                 "--device-id 3 --min-answered 0.5 --json " + scratch.file("figures.json") + " --forces " +
                 scratch.file("forces.csv") + " --snapshots " + scratch.file("surfaces"));
  ASSERT_EQ(result.code, 0) << result.output;
  const nlohmann::json figures = read_json(scratch.file("figures.json"));
  EXPECT_EQ(figures["slots_scheduled"], 1201);
  EXPECT_LE(figures["slots_sent"], 1201);
  EXPECT_LE(figures["slots_answered"], figures["slots_sent"]);
  EXPECT_GE(figures["slots_answered"].get<int>(), 600);
  EXPECT_EQ(figures["scene"], "spring");
  EXPECT_EQ(figures["elements_removed"], 1);
  EXPECT_NEAR(figures["force_peak_n"].get<double>(), 1.2, 0.01);
  EXPECT_EQ(figures["status_seen"], 0);
  EXPECT_EQ(daemon.buttons_seen(), 1u);
  // No jump at the start: the recording moves 40 µm per slot, and only client stalls add to that.
  EXPECT_LT(daemon.largest_step(), 0.02);

  // Each row's force is the spring's at the position of the same row.
  std::ifstream forces(scratch.file("forces.csv"));
  std::string line;
  std::getline(forces, line);
  EXPECT_EQ(line.substr(0, 30), "t,number,px,py,pz,buttons,fx,f");
  int rows = 0;
  while (std::getline(forces, line)) {
    double t, number, px, py, pz, buttons, fx;
    char comma;
    std::istringstream(line) >> t >> comma >> number >> comma >> px >> comma >> py >> comma >> pz >> comma >>
        buttons >> comma >> fx;
    EXPECT_NEAR(fx, -10 * px, 1e-5) << line;
    EXPECT_NEAR(px, 0.080 + 0.040 * std::min(t, 1.0), 1e-3) << line;
    EXPECT_NEAR(1000 * t, number, 1e-6);
    ++rows;
  }
  EXPECT_EQ(rows, figures["slots_answered"]);

  std::stringstream before, after;
  before << std::ifstream(scratch.file("surfaces/lens_nucleus_before.vtk")).rdbuf();
  after << std::ifstream(scratch.file("surfaces/lens_nucleus_after.vtk")).rdbuf();
  EXPECT_NE(before.str().find("POLYGONS 6 24"), std::string::npos);
  EXPECT_NE(after.str().find("POLYGONS 4 16"), std::string::npos);
}

TEST(Replay, CentresAndSpeedsUp) {
  const ScratchDirectory scratch;
  FakeDaemon daemon(test_domain(), 10);
  const CommandResult result =
      run_haptic("replay " + recording(scratch) + " --units mm --centre --scale 0.5 --speed 4 " + domain() +
                 "--min-answered 0.3 "
                 "--json " +
                 scratch.file("figures.json"));
  ASSERT_EQ(result.code, 0) << result.output;
  const nlohmann::json figures = read_json(scratch.file("figures.json"));
  EXPECT_EQ(figures["slots_scheduled"], 301);
  EXPECT_LT(figures["force_peak_n"].get<double>(), 10 * 0.5 * 0.025);
  EXPECT_GT(figures["force_peak_n"].get<double>(), 10 * 0.5 * 0.015);
}

TEST(Replay, SaysWhenNobodyKnowsTheDevice) {
  const ScratchDirectory scratch;
  FakeDaemon daemon(test_domain(), 10, 1);
  const CommandResult result =
      run_haptic("replay " + recording(scratch) + " --units mm " + domain() + "--device-id 2 --arm-wait 0.5");
  EXPECT_EQ(result.code, 1);
  EXPECT_NE(result.output.find("no force for device 2"), std::string::npos) << result.output;
}

TEST(Replay, FailsWhenTooFewSlotsAreAnswered) {
  const ScratchDirectory scratch;
  FakeDaemon daemon(test_domain(), 10);
  const CommandResult result =
      run_haptic("replay " + recording(scratch) + " --units mm " + domain() +
                 "--no-enable --min-answered 1.0 --speed 10 --json " + scratch.file("figures.json"));
  const nlohmann::json figures = read_json(scratch.file("figures.json"));
  EXPECT_EQ(result.code, figures["slots_answered"] == figures["slots_scheduled"] ? 0 : 1) << result.output;
  EXPECT_EQ(figures["force_peak_n"], 0);
  EXPECT_EQ(figures["status_seen_text"], "disarmed");
}

// Hand spring k and wall spring K: the hand rests at d k / (k + K), pushed back by K times that.
TEST(Hand, BalancesAgainstASpringOverDds) {
  const ScratchDirectory scratch;
  FakeDaemon daemon(test_domain(), 100);
  const CommandResult result = run_haptic(
      "hand --stiffness 300 --damping 15 --press 0.01,0.1,1.5 " + domain() + "--min-answered 0.3 --json " +
      scratch.file("figures.json") + " --forces " + scratch.file("forces.csv"));
  ASSERT_EQ(result.code, 0) << result.output;
  std::ifstream forces(scratch.file("forces.csv"));
  std::string line;
  double settled = 0;
  std::getline(forces, line);
  while (std::getline(forces, line)) {
    double t, number, px, py, pz;
    char comma;
    std::istringstream(line) >> t >> comma >> number >> comma >> px >> comma >> py >> comma >> pz;
    if (t < 1.5) settled = pz;
  }
  EXPECT_NEAR(settled, -0.01 * 300 / 400, 5e-5);
  const nlohmann::json figures = read_json(scratch.file("figures.json"));
  // The grip's damping drives it past its balance on the way in, never past the target.
  EXPECT_GT(figures["applied_force_peak_n"].get<double>(), 0.74);
  EXPECT_LT(figures["applied_force_peak_n"].get<double>(), 1.05);
  EXPECT_GT(figures["energy_absorbed_min_j"].get<double>(), -0.005);
}

}  // namespace
}  // namespace hapticd
