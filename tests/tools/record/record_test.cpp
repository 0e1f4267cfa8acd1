// Recordings of the daemon as a process, against its client's forces.csv, by a reader that shares no code
// with us.
#include <gtest/gtest.h>

#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "server/files/paths.h"
#include "server/observe/bag_recorder.h"
#include "server/record/bag_reader.h"
#include "tests/support/process.h"
#include "tests/tools/run_command.h"
#include "tools/record/tick_listener.h"

namespace hapticd {
namespace {

const std::string cube = SOURCE_DIR "/config/scenes/cube/cube.yaml";
const std::string compare = "/usr/bin/python3 " SOURCE_DIR "/tests/tools/record/bag_against_csv.py ";

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

// A press, and to and fro, at 1 kHz and at most 0.3 m/s: 3 mm in ten states. The client's clock began a
// second ago.
struct Press {
  static constexpr int states = 800;
  static constexpr std::int64_t begun_ns = 1'000'000'000;

  static hapticd_msg_DeviceState at(int k) {
    hapticd_msg_DeviceState s{};
    s.number = static_cast<std::uint64_t>(k + 1);
    s.client_time_ns = begun_ns + std::int64_t{1'000'000} * k;
    s.position[0] = 0.005 * std::sin(0.06 * k);
    // The tip touches at 23 mm.
    s.position[2] = 0.0245 - 0.0020 * (1 - std::cos(0.012 * k));
    s.orientation[3] = 1;
    return s;
  }
  static std::string csv() {
    std::string text = "t,px,py,pz\n";
    char line[96];
    for (int k = 0; k < states; ++k) {
      std::snprintf(line, sizeof line, "%.3f,%.17g,0,%.17g\n", 1e-3 * k, at(k).position[0],
                    at(k).position[2]);
      text += line;
    }
    return text;
  }
};

// The states and the forces that answer them come ten at a time, as through a network or to a process that
// is held up; and a stranger's states, with the same numbers, come between.
TEST(RecordDds, StatesThatComeLateInBurstsReplayAsTheyWereMoved) {
  const ScratchDirectory scratch;
  const auto number = static_cast<std::uint32_t>(140 + getpid() % 60);
  const Domain dds(number, read_dds_profile("loopback"));
  const Participant daemon_and_client(dds), recorder(dds);
  {
    Writer<hapticd_msg_DeviceState> state(daemon_and_client), stranger(daemon_and_client);
    Writer<hapticd_msg_ForceCommand> force(daemon_and_client);
    TickListener listener(recorder, 0);
    usleep(300'000);  // discovery
    BagRecorder bag(scratch.file("late"), 0);
    for (int k = 0; k < Press::states; k += 10) {
      for (int i = k; i < k + 10; ++i) {
        hapticd_msg_DeviceState s = Press::at(i);
        state.write(s);
        hapticd_msg_ForceCommand f{};
        f.number = f.echo_number = s.number;
        f.echo_client_time_ns = s.client_time_ns;
        s.client_time_ns += 7;
        s.position[2] += 0.01;
        stranger.write(s);
        force.write(f);
      }
      usleep(10'000);
      listener.take([&](const ForceRecord& r) { bag.push(r); });
    }
    EXPECT_EQ(listener.dropped(), 0u);
    bag.stop();
  }
  const std::string scene = " --offline --scene " + cube + " --forces ";
  const CommandResult moved = run_haptic("replay " + scratch.file("moved.csv", Press::csv()) + scene +
                                         scratch.file("moved_forces.csv"));
  EXPECT_EQ(moved.code, 0) << moved.output;
  const CommandResult late =
      run_haptic("replay " + scratch.file("late") + scene + scratch.file("late_forces.csv") + " --json " +
                 scratch.file("late.json"));
  EXPECT_EQ(late.code, 0) << late.output;
  const nlohmann::json figures = nlohmann::json::parse(read_bytes(scratch.file("late.json")));
  EXPECT_EQ(figures["states_refused"], 0);
  EXPECT_EQ(figures["samples"], Press::states);
  EXPECT_GT(figures["force_peak_n"], 0.01);
  EXPECT_EQ(read_bytes(scratch.file("moved_forces.csv")), read_bytes(scratch.file("late_forces.csv")));
}

// 30 mm in a millisecond is no hand's.
TEST(OfflineReplay, RefusedStatesFailItUnlessAllowed) {
  const ScratchDirectory scratch;
  std::string text = "t,px,py,pz\n";
  for (int k = 0; k < 200; ++k)
    text += std::to_string(1e-3 * k) + ",0,0," + (k == 100 ? "0.07" : "0.04") + "\n";
  const std::string run = "replay " + scratch.file("jump.csv", text) + " --offline --scene " + cube;
  const CommandResult refused = run_haptic(run);
  EXPECT_EQ(refused.code, 1) << refused.output;
  EXPECT_NE(refused.output.find("states were refused, the first at 0.1"), std::string::npos)
      << refused.output;
  EXPECT_NE(refused.output.find("max_speed is 2.00 m/s"), std::string::npos) << refused.output;
  EXPECT_NE(refused.output.find("--allow-refused"), std::string::npos) << refused.output;
  const CommandResult allowed = run_haptic(run + " --allow-refused");
  EXPECT_EQ(allowed.code, 0) << allowed.output;
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
