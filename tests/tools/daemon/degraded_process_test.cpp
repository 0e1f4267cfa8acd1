#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <thread>

#include <gtest/gtest.h>

#include "server/os/realtime.h"
#include "tests/tools/daemon/watchdog_fixture.h"

namespace hapticd {
namespace {

using namespace watchdog;

// Without the privileges it asks for, the daemon works, says what is missing, and says so to every client.
TEST(Degraded, WithoutPrivilegesTheDaemonAnnouncesItAndAnswers) {
  if (geteuid() != 0) GTEST_SKIP() << "only root has privileges to do without";
  const Domain domain(test_domain(), read_dds_profile("loopback"));
  const Participant participant(domain);
  const ScratchDirectory scratch;
  const std::string log = scratch.file("daemon.log");
  Child daemon(
      {.command = {"setpriv", "--bounding-set", "-sys_nice,-ipc_lock,-sys_resource", "prlimit",
                   "--memlock=65536", "--rtprio=0", "--nice=0", BIN_DIR "/hapticd",
                   SOURCE_DIR "/config/scenes/cube/cube.yaml", "--domain", std::to_string(domain.id())},
       .output = log});
  ScriptedClient client(participant);
  ASSERT_TRUE(client.await(patience_ms, [](const Force&) { return true; }));
  client.enable(true);
  client.move_to(touching_z, 300);
  EXPECT_TRUE(client.await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  Reader<hapticd_msg_ServerStatus> status(participant);
  std::string refused;
  for (int i = 0; i < 3000 && refused.empty(); ++i) {
    usleep(1000);
    status.take_each(
        [&](const hapticd_msg_ServerStatus& m, const dds_sample_info_t&) { refused = m.refused; });
  }
  EXPECT_NE(refused.find("SCHED_FIFO"), std::string::npos) << refused;
  EXPECT_NE(refused.find("mlockall"), std::string::npos) << refused;
  EXPECT_NE(refused.find("nice -10"), std::string::npos) << refused;
  std::ifstream in(log);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  EXPECT_NE(text.find("not granted: SCHED_FIFO"), std::string::npos) << text;
  EXPECT_NE(text.find("degraded"), std::string::npos) << text;
}

// Of the cube what is near its bottom is simulated; the ball presses its top, which is condensed.
TEST(Degraded, ADaemonSaysThatAnInstrumentReachesCondensedTissue) {
  const ScratchDirectory scratch;
  const std::filesystem::path cube = SOURCE_DIR "/config/scenes/cube";
  std::filesystem::copy_file(cube / "cube.msh", scratch.file("cube.msh"));
  std::ifstream given(cube / "cube.yaml");
  std::string text{std::istreambuf_iterator<char>(given), {}};
  const std::string key = "    mesh: cube.msh\n";
  ASSERT_NE(text.find(key), std::string::npos);
  text.insert(text.find(key), "    near: {centre: [0.01, 0.01, 0], radius: 8.0e-3}\n");
  if (const std::size_t at = text.find("\ntrajectory:"); at != std::string::npos)
    text.erase(at + 1, text.find('\n', at + 1) - at);
  std::ofstream(scratch.file("cube.yaml")) << text;
  const Domain domain(test_domain(), read_dds_profile("loopback"));
  const Participant participant(domain);
  const std::string log = scratch.file("daemon.log"), summary = scratch.file("summary.json");
  Child daemon({.command = {BIN_DIR "/hapticd", scratch.file("cube.yaml"), "--domain",
                            std::to_string(domain.id()), "--json", summary},
                .output = log});
  ScriptedClient client(participant);
  ASSERT_TRUE(client.await(patience_ms, [](const Force&) { return true; }));
  client.enable(true);
  client.move_to(touching_z, 300);
  EXPECT_TRUE(client.await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  kill(daemon.pid(), SIGTERM);
  EXPECT_EQ(daemon.wait(20), 0);
  std::ifstream in(log);
  const std::string said{std::istreambuf_iterator<char>(in), {}};
  EXPECT_NE(said.find("beyond_near"), std::string::npos) << said;
  std::ifstream figures(summary);
  EXPECT_GT(nlohmann::json::parse(figures).at("condensed_steps").get<int>(), 0);
}

// Reference factors that are made after everybody else's programs come late whenever a core is busy.
TEST(Priorities, TheSimulationGoesFirstAndItsReferencesAreAnOrdinaryProgram) {
  Grant grant;
  std::thread([&grant] { grant = use_nice(simulation_nice); }).join();
  if (!grant.granted) GTEST_SKIP() << grant.detail;
  const Domain domain(test_domain(), read_dds_profile("loopback"));
  const Participant participant(domain);
  const ScratchDirectory scratch;
  Child daemon({.command = {BIN_DIR "/hapticd", SOURCE_DIR "/config/scenes/cube/cube.yaml", "--domain",
                            std::to_string(domain.id())},
                .output = scratch.file("daemon.log")});
  ScriptedClient client(participant);
  ASSERT_TRUE(client.await(patience_ms, [](const Force&) { return true; }));
  std::map<std::string, int> nice;
  for (const auto& task :
       std::filesystem::directory_iterator("/proc/" + std::to_string(daemon.pid()) + "/task")) {
    std::string name;
    std::getline(std::ifstream(task.path() / "comm") >> std::ws, name);
    nice[name] = getpriority(PRIO_PROCESS, static_cast<id_t>(std::stoi(task.path().filename())));
  }
  ASSERT_TRUE(nice.contains("simulation") && nice.contains("references"));
  EXPECT_EQ(nice["simulation"], simulation_nice);
  EXPECT_EQ(nice["references"], getpriority(PRIO_PROCESS, 0));  // as who starts a daemon has it
}

}  // namespace
}  // namespace hapticd
