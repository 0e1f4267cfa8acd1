// Two instruments in one tissue, over DDS: the daemon, its recordings, two clients of one process, who
// listens.
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "server/files/paths.h"
#include "server/record/bag_reader.h"
#include "tests/support/process.h"
#include "tests/tools/run_command.h"
#include "tests/tools/two_instruments.h"

namespace hapticd {
namespace {

std::string domain() { return std::to_string(100 + getpid() % 100); }
std::string in_domain() { return " --domain " + domain() + " "; }

nlohmann::json read_json(const std::string& file) { return nlohmann::json::parse(std::ifstream(file)); }

// Largest force in a table of forces since then; −1 without one.
double peak_of(const std::string& file, double since = 0) {
  std::ifstream in(file);
  double peak = -1;
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    std::istringstream row(line);
    double value[9];
    char comma;
    for (double& v : value) row >> v >> comma;
    if (value[0] >= since) peak = std::max(peak, std::hypot(value[6], value[7], value[8]));
  }
  return peak;
}

class TwoHandsDaemon : public testing::Test {
 protected:
  std::vector<std::string> daemon_with(std::vector<std::string> options) const {
    std::vector<std::string> command{BIN_DIR "/hapticd", scene_, "--domain", domain(), "--log", "human"};
    command.insert(command.end(), options.begin(), options.end());
    return command;
  }
  std::string said() const {
    const std::string log = scratch_.file("log");  // the daemon makes it
    return std::filesystem::exists(log) ? read_bytes(log) : "";
  }

  const ScratchDirectory scratch_;
  const std::string scene_ = two_on_a_cube(scratch_);
};

// The second recording begins 0.2 s later, by its own stamps.
TEST_F(TwoHandsDaemon, TwoRecordingsAreTwoDevicesOnOneTimeAxis) {
  ChildProcess daemon(
      daemon_with({"--record", scratch_.file("run.csv"), "--json", scratch_.file("daemon.json")}),
      scratch_.file("log"));
  const CommandResult replay = run_haptic(
      "replay " + press_from(scratch_, "a.csv", 0) + " " + press_from(scratch_, "b.csv", 0.2) + in_domain() +
      "--min-answered 0.3 --forces " + scratch_.file("f.csv") + " --json " + scratch_.file("figures.json"));
  ASSERT_EQ(replay.code, 0) << replay.output << said();
  const nlohmann::json figures = read_json(scratch_.file("figures.json"));
  ASSERT_EQ(figures["devices"].size(), 2u);
  const nlohmann::json &left = figures["devices"][0], &right = figures["devices"][1];
  EXPECT_EQ(left["instrument"], "left");
  EXPECT_EQ(left["device_id"], 3);
  EXPECT_EQ(right["instrument"], "right");
  EXPECT_EQ(right["device_id"], 5);
  EXPECT_EQ(left["slots_scheduled"], 1201);
  EXPECT_EQ(right["slots_scheduled"], 1401);
  // Each begins at the point of its grid that is nearest to the common time.
  EXPECT_LE(figures["start_skew_us"].get<double>(), 1000);
  EXPECT_GT(peak_of(scratch_.file("f.csv")), 0.02);
  EXPECT_GT(peak_of(scratch_.file("f.right.csv")), 0.02);

  daemon.signal(SIGTERM);
  ASSERT_EQ(daemon.wait(10'000), 0) << said();
  const nlohmann::json summary = read_json(scratch_.file("daemon.json"));
  EXPECT_EQ(summary["instrument"], "left");
  ASSERT_EQ(summary["more_devices"].size(), 1u);
  EXPECT_EQ(summary["more_devices"][0]["instrument"], "right");
  EXPECT_EQ(summary["more_devices"][0]["sim_steps"], summary["sim_steps"]);
  EXPECT_GT(summary["slots_answered"], 300);
  EXPECT_GT(summary["more_devices"][0]["slots_answered"], 300);
  EXPECT_GT(std::filesystem::file_size(scratch_.file("run.csv")), 10'000u);
  EXPECT_GT(std::filesystem::file_size(scratch_.file("run.right.csv")), 10'000u);
}

// No file of either device is written over, and nothing is begun where one is in the way.
TEST_F(TwoHandsDaemon, ADerivedNameThatIsTakenIsRefusedBeforeTheRun) {
  scratch_.file("run.right.csv", "mine\n");
  const std::string start = BIN_DIR "/hapticd " + scene_ + in_domain() + "--duration 0.5 --record ";
  const CommandResult csv = run_command(start + scratch_.file("run.csv"));
  EXPECT_EQ(csv.code, 2) << csv.output;
  EXPECT_NE(csv.output.find("run.right.csv"), std::string::npos) << csv.output;
  EXPECT_FALSE(std::filesystem::exists(scratch_.file("run.csv")));
  EXPECT_EQ(read_bytes(scratch_.file("run.right.csv")), "mine\n");
  const CommandResult forced = run_command(start + scratch_.file("run.csv") + " --force");
  EXPECT_EQ(forced.code, 0) << forced.output;
  EXPECT_NE(read_bytes(scratch_.file("run.right.csv")), "mine\n");

  std::filesystem::create_directory(scratch_.file("bag.right"));
  scratch_.file("bag.right/metadata.yaml", "mine\n");
  const CommandResult bag = run_command(start + scratch_.file("bag"));
  EXPECT_EQ(bag.code, 2) << bag.output;
  EXPECT_FALSE(std::filesystem::exists(scratch_.file("bag")));

  ChildProcess daemon(daemon_with({}), scratch_.file("log"));
  scratch_.file("f.right.csv", "mine\n");
  const CommandResult replay =
      run_haptic("replay " + press_from(scratch_, "a.csv", 0) + " " + press_from(scratch_, "b.csv", 0) +
                 in_domain() + "--forces " + scratch_.file("f.csv"));
  EXPECT_EQ(replay.code, 2) << replay.output;
  EXPECT_NE(replay.output.find("f.right.csv"), std::string::npos) << replay.output;
  EXPECT_EQ(read_bytes(scratch_.file("f.right.csv")), "mine\n");
}

// Who listens hears both devices; both hands press, and who asks is told of both.
TEST_F(TwoHandsDaemon, TwoHandsPressWhileTheyAreRecordedAndLookedAt) {
  ChildProcess daemon(daemon_with({}), scratch_.file("log"));
  ChildProcess record({BIN_DIR "/haptic", "record", scratch_.file("heard"), "--vtk", scratch_.file("vtk"),
                       "--domain", domain(), "--json", scratch_.file("record.json")});
  ChildProcess hands({BIN_DIR "/haptic", "hand", "--two", "--at", "0,0,0.0245,0.001,0,0.0245", "--press",
                      "0.003,0.01,6", "--domain", domain(), "--min-answered", "0.3", "--forces",
                      scratch_.file("h.csv"), "--json", scratch_.file("hands.json")},
                     scratch_.file("hands.log"));
  // In the hold.
  for (int i = 0; i < 300 && !std::filesystem::exists(scratch_.file("vtk/contact_000040.vtp")); ++i)
    usleep(50'000);
  usleep(1'500'000);
  const CommandResult doctor = run_haptic("doctor --running " + domain());
  EXPECT_NE(doctor.output.find("2 instruments in one tissue, solved together"), std::string::npos)
      << doctor.output;
  EXPECT_NE(doctor.output.find("device 3, Touch: a client, "), std::string::npos) << doctor.output;
  EXPECT_NE(doctor.output.find("device 5, Touch: a client, "), std::string::npos) << doctor.output;
  ASSERT_EQ(hands.wait(40'000), 0) << read_bytes(scratch_.file("hands.log"));
  record.signal(SIGINT);
  EXPECT_EQ(record.wait(10'000), 0);

  const nlohmann::json figures = read_json(scratch_.file("hands.json"));
  ASSERT_EQ(figures["devices"].size(), 2u);
  for (const nlohmann::json& of : figures["devices"]) {
    EXPECT_GT(of["applied_force_peak_n"].get<double>(), 0.02) << of;
    EXPECT_GT(of["slots_answered"].get<int>(), 1000) << of;
  }
  EXPECT_GT(peak_of(scratch_.file("h.right.csv")), 0.02);

  const nlohmann::json heard = read_json(scratch_.file("record.json"));
  ASSERT_EQ(heard["devices"].size(), 2u) << heard;
  EXPECT_EQ(heard["devices"][1]["instrument"], "right");
  for (const nlohmann::json& of : heard["devices"]) EXPECT_GT(of["ticks"], 600) << of;
  for (const char* bag : {"heard", "heard.right"})
    EXPECT_GT(read_bag(scratch_.file(bag), "", LengthUnit::metre).samples.size(), 300u) << bag;
  EXPECT_NE(read_bytes(scratch_.file("vtk/contact_000009.vtp")).find("Name=\"instrument\""),
            std::string::npos);
}

TEST_F(TwoHandsDaemon, NobodyThereIsToldOfEachInstrument) {
  ChildProcess daemon(daemon_with({}), scratch_.file("log"));
  CommandResult doctor = run_haptic("doctor --running " + domain());
  for (int i = 0; i < 10 && doctor.output.find("no daemon answers") != std::string::npos; ++i)
    doctor = run_haptic("doctor --running " + domain());
  EXPECT_NE(doctor.output.find("left"), std::string::npos) << doctor.output;
  EXPECT_NE(doctor.output.find("device 3, Touch: no client"), std::string::npos) << doctor.output;
  EXPECT_NE(doctor.output.find("device 5, Touch: no client"), std::string::npos) << doctor.output;
}

// A replay or its daemon that the machine holds up for 200 ms has the device let go; the replay arms it
// again and presses on.
class TwoHandsDaemonHeldUp : public TwoHandsDaemon, public testing::WithParamInterface<const char*> {};

TEST_P(TwoHandsDaemonHeldUp, TheReplayArmsAgain) {
  ChildProcess daemon(daemon_with({}), scratch_.file("log"));
  const std::string press = scratch_.file(
      "press.csv", "t,px,py,pz\n0,0,0,0.0245\n0.3,0,0,0.0215\n3.7,0,0,0.0215\n4,0,0,0.0245\n");
  ChildProcess replay(
      {BIN_DIR "/haptic", "replay", press, "--domain", domain(), "--device-id", "3", "--json",
       scratch_.file("f.json"), "--forces", scratch_.file("f.csv"), "--min-answered", "0.8"},
      scratch_.file("replay.log"));
  for (int i = 0; i < 1000 && said().find(" armed") == std::string::npos; ++i) usleep(10'000);
  usleep(900'000);
  ChildProcess& held_up = std::string(GetParam()) == "replay" ? replay : daemon;
  held_up.signal(SIGSTOP);
  usleep(200'000);
  held_up.signal(SIGCONT);
  EXPECT_EQ(replay.wait(20'000), 0) << read_bytes(scratch_.file("replay.log"));
  const nlohmann::json figures = read_json(scratch_.file("f.json"));
  EXPECT_EQ(figures["armed_again"], 1) << said();
  EXPECT_NE(said().find("disarmed"), std::string::npos) << said();
  EXPECT_GT(peak_of(scratch_.file("f.csv"), 2.5), 0.02);
}

INSTANTIATE_TEST_SUITE_P(, TwoHandsDaemonHeldUp, testing::Values("replay", "daemon"),
                         [](const testing::TestParamInfo<const char*>& of) { return std::string(of.param); });

// The second device is nobody's: the first one does not wait for it.
TEST_F(TwoHandsDaemon, OneThatIsNotAnsweredEndsBoth) {
  ChildProcess daemon(daemon_with({}), scratch_.file("log"));
  const std::string both =
      press_from(scratch_, "a.csv", 0) + " " + press_from(scratch_, "b.csv", 0) + in_domain();
  const CommandResult unknown = run_haptic("replay " + both + "--device-id 3,9 --arm-wait 2");
  EXPECT_EQ(unknown.code, 1) << unknown.output;
  EXPECT_NE(unknown.output.find("no force for device 9"), std::string::npos) << unknown.output;
  EXPECT_EQ(run_haptic("replay " + both + "--device-id 3").code, 2);
  EXPECT_EQ(run_haptic("replay " + both + "--device-id 3,3").code, 2);
  const CommandResult three = run_haptic("replay " + scratch_.file("a.csv") + " " + both);
  EXPECT_EQ(three.code, 2) << three.output;
  EXPECT_NE(three.output.find("has 2 instruments"), std::string::npos) << three.output;
}

}  // namespace
}  // namespace hapticd
