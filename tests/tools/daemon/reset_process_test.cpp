// A running daemon begins its scene again, or another one, while somebody presses.
#include <csignal>
#include <filesystem>
#include <fstream>

#include "server/dds/command.h"
#include "server/files/paths.h"
#include "tests/tools/daemon/watchdog_fixture.h"

namespace hapticd::watchdog {
namespace {

namespace fs = std::filesystem;

// With a scene of its own, which may change.
class ResetWatchdog : public Watchdog {
 protected:
  void serve() {
    fs::copy(SOURCE_DIR "/config/scenes/cube", folder_);
    daemon_.emplace(ChildSettings{.command = {BIN_DIR "/hapticd", (folder_ / "cube.yaml").string(),
                                              "--domain", std::to_string(domain_.id()), "--mode", GetParam()},
                                  .output = log_.file("daemon.log")});
    client_.emplace(participant_);
    ASSERT_TRUE(client_->await(patience_ms, [](const Force&) { return true; })) << "no force came";
  }
  void change(const std::string& from, const std::string& to) {
    std::string text = read_bytes(folder_ / "cube.yaml");
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    std::ofstream(folder_ / "cube.yaml") << text.replace(at, from.size(), to);
  }
  double resting() {
    for (int turn = 0; turn < 100; ++turn) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    double sum = 0;
    const std::vector<Force> forces = client_->forces(client_->count() - 50);
    for (const Force& f : forces) sum += magnitude(f) / static_cast<double>(forces.size());
    return sum;
  }
  // What came since `from`: within the slew limit at every tick, zero for some time, and a problem again.
  void expect_zero_between(std::size_t from) {
    const std::vector<Force> forces = client_->forces(from);
    expect_bounded(forces, touch_step, 3.3);
    int zeros = 0;
    for (std::size_t i = 1; i < forces.size(); ++i) {
      const double now = magnitude(forces[i]), before = magnitude(forces[i - 1]);
      // Zero is no exemption here.
      if (forces[i].number == forces[i - 1].number + 1) {
        EXPECT_LE(std::abs(now - before), touch_step * (1 + 1e-6)) << forces[i].number;
      }
      zeros += now == 0 && has(forces[i], status_problem_lost);
    }
    EXPECT_GT(zeros, 5);
    EXPECT_FALSE(has(forces.back(), status_problem_lost | status_disarmed | status_latched));
  }
  CommandReply ask(ServerCommand command) { return ask_server(participant_, command, 20); }

  const fs::path folder_ = fs::path(log_.file("cube"));
};

TEST_P(ResetWatchdog, AResetPassesThroughZeroWithinTheSlewLimitAndPressesAgain) {
  serve();
  touch();
  const double before = resting();
  const std::size_t from = client_->count();
  const auto begun = std::chrono::steady_clock::now();
  const CommandReply reply = ask(ServerCommand::reset);
  EXPECT_TRUE(reply.heard && reply.done) << reply.message;
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(2));  // discovery included
  EXPECT_LT(std::stoi(reply.message.substr(reply.message.find("after ") + 6)), 1000) << reply.message;
  ASSERT_TRUE(
      client_->await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  const double after = resting();
  EXPECT_NEAR(after, before, 0.1 * before);
  expect_zero_between(from - 1);
}

TEST_P(ResetWatchdog, AReloadedSceneIsFeltAndAFaultyOneChangesNothing) {
  serve();
  touch();
  const double before = resting();

  change("young: 5.0e3", "young: -1");
  std::size_t from = client_->count();
  CommandReply reply = ask(ServerCommand::reload);
  EXPECT_TRUE(reply.heard && !reply.done);
  EXPECT_NE(reply.message.find("material.young"), std::string::npos) << reply.message;
  for (const Force& f : client_->forces(from)) EXPECT_FALSE(has(f, status_problem_lost));
  EXPECT_NEAR(resting(), before, 0.1 * before);

  change("young: -1", "young: 1.0e4");
  from = client_->count();
  reply = ask(ServerCommand::reload);
  EXPECT_TRUE(reply.done) << reply.message;
  EXPECT_NE(reply.message.find("1 anew"), std::string::npos) << reply.message;
  ASSERT_TRUE(
      client_->await(patience_ms, [](const Force& f) { return f.status == 0 && magnitude(f) > 0.02; }));
  EXPECT_GT(resting(), 1.5 * before);  // the coupling gives way as well
  expect_zero_between(from - 1);
}

TEST_P(ResetWatchdog, WhoAsksWithoutEndDoesNotKeepTheDaemonFromItsEnd) {
  serve();
  std::jthread asks([this](const std::stop_token& stop) {
    Writer<hapticd_msg_ServerCommand> commands(participant_);
    for (hapticd_msg_ServerCommand m{}; !stop.stop_requested(); ++m.asker) {
      commands.write(m);
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
  });
  std::this_thread::sleep_for(std::chrono::seconds(2));  // discovery, and some resets
  daemon_->signal(SIGTERM);
  EXPECT_EQ(daemon_->wait(5), 0) << read_bytes(log_.file("daemon.log"));
}

INSTANTIATE_TEST_SUITE_P(, ResetWatchdog, testing::Values("tick", "event"),
                         [](const auto& mode) { return std::string(mode.param); });

}  // namespace
}  // namespace hapticd::watchdog
