// Recordings of the daemon as a process, against its client's forces.csv, by a reader that shares no code
// with us.
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "server/bag_reader.h"
#include "server/paths.h"
#include "tests/support/process.h"
#include "tests/tools/run_command.h"

namespace hapticd {
namespace {

const std::string cube = SOURCE_DIR "/config/scenes/cube/cube.yaml";
const std::string compare = "/usr/bin/python3 " SOURCE_DIR "/tests/tools/bag_against_csv.py ";

// Down onto the cube, 1.5 mm deep, sideways, and up: 1.2 s.
std::string press(const ScratchDirectory& scratch) {
  return scratch.file("press.csv",
                      "t,px,py,pz,buttons\n0,0,0,0.0245,0\n0.3,0,0,0.0215,0\n0.6,0,0,0.0215,1\n"
                      "0.9,0.002,0,0.0215,1\n1.2,0.002,0,0.0245,0\n");
}

std::string domain() { return std::to_string(140 + getpid() % 60); }

TEST(RecordDaemon, TheBagHasWhatTheClientFelt) {
  const ScratchDirectory scratch;
  ChildProcess daemon({BIN_DIR "/hapticd", cube, "--domain", domain(), "--record", scratch.file("bag"),
                       "--json", scratch.file("daemon.json")},
                      scratch.file("log"));
  ChildProcess record({BIN_DIR "/haptic", "record", scratch.file("heard"), "--vtk", scratch.file("vtk"),
                       "--domain", domain(), "--duration", "0", "--json", scratch.file("record.json")});
  const CommandResult replay =
      run_haptic("replay " + press(scratch) + " --from-scene " + cube + " --domain " + domain() +
                 " --min-answered 0.3 --forces " + scratch.file("forces.csv"));
  ASSERT_EQ(replay.code, 0) << replay.output;
  record.signal(SIGINT);
  record.wait(10'000);
  daemon.signal(SIGTERM);
  ASSERT_EQ(daemon.wait(10'000), 0) << read_bytes(scratch.file("log"));

  const CommandResult same = run_command(compare + scratch.file("bag") + " " + scratch.file("forces.csv"));
  EXPECT_EQ(same.code, 0) << same.output;
  const nlohmann::json figures = nlohmann::json::parse(read_bytes(scratch.file("daemon.json")));
  EXPECT_EQ(figures["recording_lost"], 0);
  EXPECT_EQ(figures["recording_dropped"], 0);
  EXPECT_FALSE(figures["recording_failed"]);
  EXPECT_GT(figures["recorded"], 1200);

  // Whoever listens may miss what DDS loses, and hears no other poses.
  const nlohmann::json heard = nlohmann::json::parse(read_bytes(scratch.file("record.json")));
  EXPECT_GT(heard["ticks"], 600) << heard;
  EXPECT_EQ(heard["messages_lost"], 0) << heard;
  EXPECT_GT(heard["frames"], 10) << heard;
  EXPECT_GT(read_bag(scratch.file("heard"), "", LengthUnit::metre).samples.size(), 300u);
  EXPECT_NE(read_bytes(scratch.file("vtk/scene.pvd")).find("file=\"contact_000009.vtp\""), std::string::npos);
}

// A killed daemon leaves a bag that opens, and lost a second at most.
TEST(RecordDaemon, AKilledDaemonLeavesAWholeBag) {
  const ScratchDirectory scratch;
  ChildProcess daemon({BIN_DIR "/hapticd", cube, "--domain", domain(), "--record", scratch.file("bag")});
  // The first commits are there.
  for (int i = 0; i < 1000; ++i) {
    std::error_code error;
    if (std::filesystem::exists(scratch.file("bag/metadata.yaml"), error) &&
        read_bytes(scratch.file("bag/metadata.yaml")).find("\n  message_count: 0\n") == std::string::npos)
      break;
    usleep(10'000);
  }
  daemon.signal(SIGKILL);
  daemon.wait(2000);
  const CommandResult count = run_command(
      "/usr/bin/python3 -c \"import sqlite3,glob; print(sqlite3.connect(glob.glob('" + scratch.file("bag") +
      "/*.db3')[0]).execute('SELECT count(*) >= 300 FROM messages').fetchone()[0], "
      "sqlite3.connect(glob.glob('" +
      scratch.file("bag") + "/*.db3')[0]).execute('PRAGMA integrity_check').fetchone()[0])\"");
  EXPECT_EQ(count.output, "1 ok\n");
}

TEST(OfflineReplay, TwoRunsAgreeBitForBitAndARecordingRepeatsItself) {
  const ScratchDirectory scratch;
  const auto run = [&](const std::string& from, const std::string& name) {
    const CommandResult result =
        run_haptic("replay " + from + " --offline --forces " + scratch.file(name + ".csv") + " --record " +
                   scratch.file(name) + " --vtk " + scratch.file(name + "_vtk") + " --json " +
                   scratch.file(name + ".json"));
    EXPECT_EQ(result.code, 0) << result.output;
    return read_bytes(scratch.file(name + ".csv"));
  };
  const std::string motion = press(scratch) + " --from-scene " + cube;
  const std::string first = run(motion, "a"), second = run(motion, "b");
  EXPECT_EQ(first, second);
  EXPECT_EQ(read_bytes(scratch.file("a/a_0.db3")), read_bytes(scratch.file("b/b_0.db3")));
  EXPECT_EQ(read_bytes(scratch.file("a_vtk/contact_000012.vtp")),
            read_bytes(scratch.file("b_vtk/contact_000012.vtp")));
  const nlohmann::json figures = nlohmann::json::parse(read_bytes(scratch.file("a.json")));
  EXPECT_GT(figures["force_peak_n"], 0.02);
  EXPECT_GT(figures["elements_removed"], 0);
  EXPECT_EQ(figures["not_finite"], 0);

  // Every row, by the reader that is not ours; and the recording, played, is the same motion and the same
  // forces.
  const CommandResult same =
      run_command(compare + scratch.file("a") + " " + scratch.file("a.csv") + " --every");
  EXPECT_EQ(same.code, 0) << same.output;
  EXPECT_EQ(run(scratch.file("a") + " --scene " + cube, "c"), first);
}

TEST(OfflineReplay, UsageIsChecked) {
  const ScratchDirectory scratch;
  const std::string motion = press(scratch);
  EXPECT_EQ(run_haptic("replay " + motion + " --offline").code, 2);
  EXPECT_EQ(run_haptic("replay " + motion + " --vtk " + scratch.file("v")).code, 2);
  EXPECT_EQ(run_haptic("record").code, 2);
  EXPECT_EQ(run_haptic("replay " + scratch.file("none.db3") + " --offline --scene " + cube).code, 2);
}

}  // namespace
}  // namespace hapticd
