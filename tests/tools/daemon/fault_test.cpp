// What goes wrong around a daemon: a full disk, files that vanish, a clock that is set, too little memory, a
// kill. Each time somebody presses into the cube meanwhile, and must not feel it, or feel only what the table
// says.
#include <fcntl.h>
#include <sys/mman.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include <gtest/gtest.h>

#include "server/files/paths.h"
#include "server/record/bag_reader.h"
#include "tests/support/process.h"
#include "tests/tools/run_command.h"
#include "tests/tools/scripted_client.h"

namespace hapticd {
namespace {

namespace fs = std::filesystem;
using Force = ScriptedClient::Force;

const std::string cube = SOURCE_DIR "/config/scenes/cube/cube.yaml";

void pause(int milliseconds) { std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds)); }

bool felt(const Force& f) { return f.status == 0 && ScriptedClient::magnitude(f) > 0.02; }

class FaultDaemon : public testing::Test {
 protected:
  FaultDaemon()
      : id_(static_cast<std::uint32_t>(150 + getpid() % 50)),
        domain_(id_, read_dds_profile("loopback")),
        participant_(domain_),
        client_(participant_) {}
  // A shell's words, with the daemon's own as "$@".
  std::vector<std::string> under(const std::string& shell, const std::string& options) const {
    return {"/bin/bash", "-c",
            shell + "exec " BIN_DIR "/hapticd " + cube + " --domain " + std::to_string(id_) + " " + options};
  }
  // Presses 1.5 mm into the cube.
  [[nodiscard]] bool press() {
    client_.enable(true);
    if (!client_.await(20'000, [](const Force& f) { return (f.status & status_disarmed) == 0; }))
      return false;
    client_.move_to(0.0215, 200);
    return client_.await(5000, felt);
  }
  // For so long the force stays what it is: same side of everything, no status but what a busy machine makes.
  void expect_undisturbed(int milliseconds) {
    constexpr std::uint32_t machine = status_holding | status_ramping_down | status_ramping_up | status_gap |
                                      status_problem_old | status_slew_limited | status_blending |
                                      status_solver_cap;
    const std::size_t from = client_.count();
    pause(milliseconds);
    const std::vector<Force> forces = client_.forces(from);
    EXPECT_GT(static_cast<double>(forces.size()), answered_share() * 0.5 * milliseconds);
    double steady = 0;
    for (const Force& f : forces) {
      EXPECT_EQ(f.status & ~machine, 0u) << f.status;
      EXPECT_LT(ScriptedClient::magnitude(f), 3.3);
      steady = std::max(steady, ScriptedClient::magnitude(f));
    }
    EXPECT_GT(steady, 0.02);
  }
  nlohmann::json figures() const { return nlohmann::json::parse(read_bytes(scratch_.file("figures.json"))); }
  std::string log() const { return read_bytes(scratch_.file("log")); }

  ScratchDirectory scratch_;
  std::uint32_t id_;
  Domain domain_;
  Participant participant_;
  ScriptedClient client_;
};

class FullDiskDaemon : public FaultDaemon, public testing::WithParamInterface<const char*> {};

TEST_P(FullDiskDaemon, TheRecordingEndsAndIsCountedAndTheForceGoesOn) {
  const std::string kind = GetParam(), disk = scratch_.file("disk");
  fs::create_directories(disk);
  std::string before, target = disk + "/bag";
  if (kind == "limit") {
    before = "ulimit -f 600; ";
  } else if (kind == "tmpfs") {
    const std::string mount = "mount -t tmpfs -o size=600k tmpfs " + disk;
    std::string own = "unshare --mount ";
    if (run_command(own + "bash -c '" + mount + "'").code != 0)
      own = "unshare --user --map-root-user --mount ";
    if (run_command(own + "bash -c '" + mount + "'").code != 0)
      GTEST_SKIP() << "no file system may be mounted here";
    before = "[ -n \"$MOUNTED\" ] || MOUNTED=1 exec " + own + "bash -c '" + mount +
             "; MOUNTED=1 exec " BIN_DIR "/hapticd " + cube + " --domain " + std::to_string(id_) +
             " --record " + target + " --json " + scratch_.file("figures.json") + "'; ";
  } else {
    target = scratch_.file("full.csv");
    fs::create_symlink("/dev/full", target);
  }
  ChildProcess daemon(under(before, "--record " + target + " --json " + scratch_.file("figures.json")),
                      scratch_.file("log"));
  ASSERT_TRUE(press()) << log();
  expect_undisturbed(2500);
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(10'000), 0) << log();
  const nlohmann::json j = figures();
  EXPECT_EQ(j["recording_failed"], true);
  EXPECT_GT(j["recording_lost"], 0);
  EXPECT_EQ(j["recording_dropped"], 0);
  EXPECT_NE(log().find("the recording ends"), std::string::npos) << log();
  EXPECT_EQ(log().find("the recording ends", log().find("the recording ends") + 1), std::string::npos)
      << "said twice";
  if (kind == "limit") {  // what was committed is whole
    EXPECT_GT(read_bag(target, "", LengthUnit::metre).samples.size(), 2u);
    EXPECT_GT(j["recorded"], 0);
  }
}
INSTANTIATE_TEST_SUITE_P(Kinds, FullDiskDaemon, testing::Values("limit", "tmpfs", "csv"),
                         [](const auto& test) { return std::string(test.param); });

TEST_F(FaultDaemon, FilesThatVanishMidRunAreNotMissed) {
  const std::string scene = scratch_.file("scene"), config = scratch_.file("config");
  fs::copy(fs::path(cube).parent_path(), scene);
  fs::create_directories(config);
  fs::copy(SOURCE_DIR "/config/devices", config + "/devices", fs::copy_options::recursive);
  fs::copy(SOURCE_DIR "/config/dds", config + "/dds", fs::copy_options::recursive);
  ChildProcess daemon(
      {"/bin/bash", "-c",
       "cd " + scene + "; HAPTICD_CONFIG_DIR=" + config + " exec " BIN_DIR "/hapticd cube.yaml --domain " +
           std::to_string(id_) + " --record " + scratch_.file("bag")},
      scratch_.file("log"));
  ASSERT_TRUE(press()) << log();
  for (const std::string& gone : {scene, config, scratch_.file("bag")}) {
    fs::remove_all(gone);
    expect_undisturbed(800);
  }
  pause(800);  // until the recorder has found out
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(10'000), 0) << log();
  EXPECT_NE(log().find("the recording ends"), std::string::npos) << log();
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
// An hour forth, two back, one forth: neither loop, nor watchdog, nor DDS, nor the recording's stamps know.
TEST_F(FaultDaemon, AWallClockThatIsSetIsNotFelt) {
  const std::string file = scratch_.file("jump", std::string(8, '\0'));
  const int fd = open(file.c_str(), O_RDWR);
  auto* jump = static_cast<volatile std::int64_t*>(
      mmap(nullptr, sizeof(std::int64_t), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0));
  close(fd);
  ASSERT_NE(jump, MAP_FAILED);
  ChildProcess daemon(under("export LD_PRELOAD=" JUMPING_CLOCK_LIBRARY " JUMPING_CLOCK=" + file + "; ",
                            "--record " + scratch_.file("bag") + " --json " + scratch_.file("figures.json")),
                      scratch_.file("log"));
  ASSERT_TRUE(press()) << log();
  for (const std::int64_t seconds : {3600, -3600, 0}) {
    *jump = 1'000'000'000 * seconds;
    expect_undisturbed(1200);
  }
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(10'000), 0) << log();
  EXPECT_EQ(figures()["recording_lost"], 0);
  const Trajectory motion = read_bag(scratch_.file("bag"), "", LengthUnit::metre);
  // By the headers' stamps, which would not rise else, and a few seconds in all.
  EXPECT_GT(motion.end(), 3.5);
  EXPECT_LT(motion.end(), 60);
}
#endif

// The client stays; the daemon is killed in contact and started again: zero or the last force meanwhile is
// the driver's, then a ramp, not a blow.
TEST_F(FaultDaemon, AKilledDaemonThatComesBackIsFeltInARamp) {
  for (int life = 0; life < 3; ++life) {
    ChildProcess daemon(under("", ""), scratch_.file("log"));
    std::size_t from = client_.count();
    if (life == 0) {
      ASSERT_TRUE(press()) << log();
    }
    // Of the lives after the first the client does nothing: it is pressing still.
    ASSERT_TRUE(client_.await(20'000, felt, from)) << "life " << life << ": " << log();
    std::vector<Force> forces = client_.forces(from);
    if (life > 0) {
      double before = 0, first_ms = -1, full_ms = -1, steady = ScriptedClient::magnitude(forces.back());
      for (const Force& f : forces) {
        const double now = ScriptedClient::magnitude(f);
        const auto ms = static_cast<double>(f.number);
        if (first_ms < 0 && !(f.status & status_disarmed)) first_ms = ms;
        if (full_ms < 0 && f.status == 0) full_ms = ms;
        EXPECT_LE(now, 1.2 * steady) << "life " << life;
        EXPECT_LE(now - before, 0.2 * std::max(1.0, now)) << "the device's slew: 200 N/s";
        before = now;
      }
      EXPECT_GE(full_ms - first_ms, 80) << "life " << life << ": the ramp takes 100 ms";
    }
    daemon.signal(SIGKILL);
    daemon.wait(5000);
    pause(300);
  }
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // whose shadows need all there is
TEST(OutOfMemory, AtTheStartIsSaidAndEndsWithOne) {
  int refused = 0, ran = 0;
  for (int megabytes = 40; megabytes <= 1000 && ran == 0; megabytes = megabytes * 5 / 4) {
    const auto run_with = [&](const std::string& command) {
      return run_command("bash -c 'ulimit -v " + std::to_string(1024 * megabytes) + "; exec " + command +
                         "'");
    };
    // Before main it is the loader's to say, or OpenBLAS's, or octomap's, which makes a static object. (With
    // hardly more, OpenBLAS spins at the end of a program that says its version.)
    if (run_with("timeout 5 " BIN_DIR "/hapticd --version").output.find("hapticd ") == std::string::npos)
      continue;
    const CommandResult r = run_with(BIN_DIR "/hapticd " + cube + " --duration 0.1 --domain " +
                                     std::to_string(100 + getpid() % 50));
    SCOPED_TRACE(std::to_string(megabytes) + " MB: " + r.output);
    EXPECT_TRUE(r.code == 0 || r.code == 1) << r.code;
    if (r.code == 1) {
      EXPECT_NE(r.output.find("memory"), std::string::npos);
      ++refused;
    }
    ran += r.code == 0;
  }
  EXPECT_EQ(ran, 1);
  EXPECT_GT(refused, 0);
}
#endif

}  // namespace
}  // namespace hapticd
