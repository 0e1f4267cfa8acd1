// A daemon whose halves are two processes: what a hand feels, and what it feels when one of them is gone.
#include <chrono>
#include <cmath>
#include <thread>

#include <gtest/gtest.h>

#include "server/dds/network.h"
#include "server/files/paths.h"
#include "tests/tools/edge/felt_at_edge.h"
#include "tests/tools/fake_daemon.h"
#include "tests/tools/run_command.h"
#include "tools/cli/child.h"

namespace hapticd {
namespace {

const std::string cube = SOURCE_DIR "/config/scenes/cube/cube.yaml";

class EdgeDaemon : public testing::Test {
 protected:
  EdgeDaemon() : domain_(test_domain(), read_dds_profile("loopback")), participant_(domain_) {}

  std::unique_ptr<Child> run(const std::string& log, std::vector<std::string> command) {
    return std::make_unique<Child>(
        ChildSettings{.command = std::move(command), .output = scratch_.file(log)});
  }
  std::unique_ptr<Child> simulation(const std::string& log = "simulation") {
    return run(log, {BIN_DIR "/hapticd", cube, "--no-haptics", "--domain", std::to_string(domain_.id()),
                     "--log", "json"});
  }
  std::unique_ptr<Child> edge(const std::string& log = "edge", std::uint32_t device_domain = 0) {
    const std::uint32_t devices = device_domain ? device_domain : domain_.id();
    return run(log,
               {BIN_DIR "/haptic", "edge", cube, "--domain", std::to_string(devices), "--simulation-domain",
                std::to_string(domain_.id()), "--log", "json", "--json", scratch_.file(log + ".json")});
  }
  std::string log(const std::string& name) const { return read_bytes(scratch_.file(name)); }
  void let_go_and_enable() {
    client_.enable(false);
    EXPECT_TRUE(client_.await(patience_ms, [](const Force& f) { return has(f, status_disarmed); }));
    pause(30);
    client_.enable(true);
  }
  bool press() {
    if (!client_.await(patience_ms, [](const Force&) { return true; })) return false;
    let_go_and_enable();
    // Armed above the cube: in it, friction would hold what is chance.
    if (!client_.await(patience_ms, [](const Force& f) { return f.status == 0; })) return false;
    client_.move_to(touching_z, 300);
    return client_.await(patience_ms, felt);
  }
  bool says(const std::string& file, const std::string& text) {
    for (int i = 0; i < patience_ms; ++i, pause(1))
      if (log(file).find(text) != std::string::npos) return true;
    return false;
  }

  Domain domain_;
  Participant participant_;
  ScratchDirectory scratch_;
  ScriptedClient client_{participant_};
};

TEST_F(EdgeDaemon, AHandFeelsTheTissueOfAnotherProcess) {
  double alone = 0;
  {
    auto whole = run("whole", {BIN_DIR "/hapticd", cube, "--domain", std::to_string(domain_.id())});
    ASSERT_TRUE(press()) << log("whole");
    pause(1000);
    alone = magnitude(client_.forces().back());
    client_.move_to(0.030, 100);
  }
  pause(1000);
  auto half = simulation();
  auto hand = edge();
  ASSERT_TRUE(press()) << log("edge") << log("simulation");
  pause(1000);
  EXPECT_NEAR(magnitude(client_.forces().back()), alone, 0.01 * alone);
  expect_bounded(client_.forces());
}

TEST_F(EdgeDaemon, AKilledSimulationIsAnOldProblemThenALostOne) {
  auto half = simulation();
  auto hand = edge();
  ASSERT_TRUE(press()) << log("edge") << log("simulation");
  const std::size_t from = client_.count();
  half->signal(SIGKILL);
  ASSERT_TRUE(client_.await(
      patience_ms, [](const Force& f) { return has(f, status_problem_lost) && magnitude(f) == 0; }, from));
  const std::vector<Force> forces = client_.forces(from);
  expect_bounded(forces);
  for (const Force& f : forces) {
    if (f.problem_age_ms >= 60 && f.problem_age_ms < 200) {
      EXPECT_TRUE(has(f, status_problem_old)) << f.problem_age_ms;
    }
    if (f.problem_age_ms >= 200) {
      EXPECT_TRUE(has(f, status_problem_lost)) << f.problem_age_ms;
    }
  }
  // Another one is refused until this one was silent for half a second, and no rival: then the force is back.
  auto next = simulation("next");
  EXPECT_TRUE(client_.await(patience_ms, felt)) << log("edge") << log("next");
  expect_bounded(client_.forces(from));
  for (const Force& f : client_.forces(from)) EXPECT_FALSE(has(f, status_latched)) << f.number;
}

TEST_F(EdgeDaemon, AStoppedSimulationComesBack) {
  auto half = simulation();
  auto hand = edge();
  ASSERT_TRUE(press()) << log("edge") << log("simulation");
  const std::size_t from = client_.count();
  half->signal(SIGSTOP);
  EXPECT_TRUE(client_.await(
      patience_ms, [](const Force& f) { return has(f, status_problem_lost) && magnitude(f) == 0; }, from));
  half->signal(SIGCONT);
  EXPECT_TRUE(client_.await(patience_ms, felt));
  expect_bounded(client_.forces(from));
}

TEST_F(EdgeDaemon, AKilledEdgeIsSilentAndTheNextOneServes) {
  auto half = simulation();
  auto hand = edge();
  ASSERT_TRUE(press()) << log("edge") << log("simulation");
  hand->signal(SIGKILL);
  hand->wait(5);
  pause(50);
  const std::size_t from = client_.count();
  pause(300);
  EXPECT_EQ(client_.count(), from);  // nobody writes: a driver is at zero after 10 ms
  auto next = edge("next");
  ASSERT_TRUE(client_.await(
      patience_ms, [](const Force&) { return true; }, from))
      << log("next");
  let_go_and_enable();
  EXPECT_TRUE(client_.await(patience_ms, felt)) << log("next") << log("simulation");
  expect_bounded(client_.forces(from));
}

TEST_F(EdgeDaemon, ASecondSimulationDisarmsAsASecondDaemonDoes) {
  auto half = simulation();
  auto hand = edge();
  ASSERT_TRUE(press()) << log("edge") << log("simulation");
  const std::size_t from = client_.count();
  auto second = simulation("second");
  EXPECT_TRUE(client_.await(
      patience_ms,
      [](const Force& f) { return has(f, status_rival) && has(f, status_latched) && magnitude(f) == 0; },
      from))
      << log("edge") << log("second");
  expect_bounded(client_.forces(from));
  EXPECT_NE(log("edge").find("a second simulation"), std::string::npos) << log("edge");
  second->signal(SIGKILL);
  second->wait(5);
  pause(1000);
  let_go_and_enable();
  EXPECT_TRUE(client_.await(patience_ms, felt)) << log("edge");
}

TEST_F(EdgeDaemon, ASecondEdgeWithDevicesOfItsOwnDoesNotArm) {
  auto half = simulation();
  auto hand = edge();
  ASSERT_TRUE(press()) << log("edge") << log("simulation");
  const std::uint32_t elsewhere = domain_.id() + 100;
  const Domain other_domain(elsewhere, read_dds_profile("loopback"));
  const Participant other_participant(other_domain);
  ScriptedClient other(other_participant);
  other.enable(true);
  auto second = edge("second", elsewhere);
  ASSERT_TRUE(other.await(patience_ms, [](const Force&) { return true; })) << log("second");
  EXPECT_TRUE(says("second", "another edge")) << log("second");
  EXPECT_TRUE(says("simulation", "\"event\":\"second_edge\"")) << log("simulation");
  pause(500);
  for (const Force& f : other.forces()) {
    EXPECT_TRUE(has(f, status_disarmed));
    EXPECT_EQ(magnitude(f), 0);
  }
  EXPECT_TRUE(client_.await(patience_ms, felt));  // the first goes on
}

TEST_F(EdgeDaemon, AnotherSceneIsRefusedAndSaid) {
  auto half = simulation();
  auto hand =
      run("edge", {BIN_DIR "/haptic", "edge", SOURCE_DIR "/config/scenes/cataract/cataract.yaml", "--domain",
                   std::to_string(domain_.id()), "--simulation-domain", std::to_string(domain_.id())});
  EXPECT_TRUE(says("edge", "another scene")) << log("edge");
  client_.enable(true);
  pause(500);
  for (const Force& f : client_.forces()) EXPECT_EQ(magnitude(f), 0);
}

// The process's own station, for what it makes meanwhile.
struct AtStation {
  explicit AtStation(const std::string& name) {
    use_network({.interface = {}, .peers = {}, .station = name});
  }
  ~AtStation() { use_network({}); }
};

class StationDaemon : public testing::Test {
 protected:
  std::unique_ptr<Child> daemon(const std::string& station, const std::string& log) {
    return std::make_unique<Child>(
        ChildSettings{.command = {BIN_DIR "/hapticd", cube, "--domain", std::to_string(domain_.id()),
                                  "--station", station, "--log", "json"},
                      .output = scratch_.file(log)});
  }
  std::unique_ptr<ScriptedClient> client(const std::string& station) {
    const AtStation here(station);
    auto made = std::make_unique<ScriptedClient>(participant_);
    made->enable(true);
    return made;
  }
  static bool press(ScriptedClient& client) {
    if (!client.await(patience_ms, [](const Force&) { return true; })) return false;
    client.enable(false);
    pause(100);
    client.enable(true);
    client.move_to(touching_z, 300);
    return client.await(patience_ms, felt);
  }

  Domain domain_{test_domain(), read_dds_profile("loopback")};
  Participant participant_{domain_};
  ScratchDirectory scratch_;
};

TEST_F(StationDaemon, TwoWithTheSameDeviceDoNotHearOneAnother) {
  auto a = client("lab.a"), b = client("lab.b");
  auto first = daemon("lab.a", "a"), second = daemon("lab.b", "b");
  ASSERT_TRUE(press(*a)) << read_bytes(scratch_.file("a"));
  ASSERT_TRUE(b->await(patience_ms, [](const Force&) { return true; }));
  // b's hand is above the cube.
  for (const Force& f : b->forces()) EXPECT_EQ(magnitude(f), 0);
  ASSERT_TRUE(press(*b)) << read_bytes(scratch_.file("b"));
  EXPECT_EQ(a->strange_forces(), 0u);
  EXPECT_EQ(b->strange_forces(), 0u);
  for (const char* log : {"a", "b"})
    EXPECT_EQ(read_bytes(scratch_.file(log)).find("second_daemon"), std::string::npos);
}

TEST_F(StationDaemon, TwoOfOneNameAndDeviceSaySoAndDoNotArm) {
  auto hand = client("lab.a");
  auto first = daemon("lab.a", "first"), second = daemon("lab.a", "second");
  hand->move_to(touching_z, 500);
  const auto said = [&](const char* log) {
    for (int i = 0; i < patience_ms; ++i, pause(1))
      if (read_bytes(scratch_.file(log)).find("\"event\":\"second_daemon\"") != std::string::npos)
        return true;
    return false;
  };
  EXPECT_TRUE(said("first"));
  EXPECT_TRUE(said("second"));
  pause(500);
  const std::size_t from = hand->count();
  pause(500);
  for (const Force& f : hand->forces(from)) EXPECT_EQ(magnitude(f), 0);
}

}  // namespace
}  // namespace hapticd
