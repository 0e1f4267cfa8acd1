// A mentor's hand: a daemon with a trainee's device, an edge with the mentor's, one tissue; and what each
// feels when the other is gone.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "server/files/paths.h"
#include "tests/tools/edge/felt_at_edge.h"
#include "tests/tools/fake_daemon.h"
#include "tests/tools/two_instruments.h"
#include "tools/cli/child.h"

namespace hapticd {
namespace {

constexpr double above_z = 0.030;  // [m]

class MentorDaemon : public testing::Test {
 protected:
  MentorDaemon() : domain_(test_domain(), read_dds_profile("loopback")), participant_(domain_) {}

  std::unique_ptr<Child> run(const std::string& log, std::vector<std::string> command) {
    return std::make_unique<Child>(
        ChildSettings{.command = std::move(command), .output = scratch_.file(log)});
  }
  std::unique_ptr<Child> daemon(const std::vector<std::string>& options) {
    std::vector<std::string> command{BIN_DIR "/hapticd",           scene_,  "--domain",
                                     std::to_string(domain_.id()), "--log", "json"};
    command.insert(command.end(), options.begin(), options.end());
    return run("daemon", command);
  }
  // link: the domain of its simulation; 0: that of the devices.
  std::unique_ptr<Child> edge(std::uint32_t link = 0) {
    const std::string domain = std::to_string(domain_.id()),
                      simulation = std::to_string(link ? link : domain_.id());
    return run("edge",
               {BIN_DIR "/haptic", "edge", scene_, "--devices", "5", "--domain", domain,
                "--simulation-domain", simulation, "--log", "json", "--json", scratch_.file("edge.json")});
  }
  std::string log(const std::string& name) const { return read_bytes(scratch_.file(name)); }
  static bool arm(ScriptedClient& client) {
    if (!client.await(patience_ms, [](const Force&) { return true; })) return false;
    client.enable(false);
    if (!client.await(patience_ms, [](const Force& f) { return has(f, status_disarmed); })) return false;
    pause(30);
    client.enable(true);
    return client.await(patience_ms, [](const Force& f) { return f.status == 0; });
  }
  static bool press(ScriptedClient& client) {
    if (!arm(client)) return false;
    client.move_to(touching_z, 300);
    return client.await(patience_ms, felt);
  }
  // Of the newest half second: a force that fades where the machine holds a client up does not count.
  static double median(const ScriptedClient& client) {
    const std::vector<Force> forces = client.forces();
    const std::size_t n = std::min<std::size_t>(forces.size(), 500);
    std::vector<double> sizes;
    for (std::size_t i = forces.size() - n; i < forces.size(); ++i) sizes.push_back(magnitude(forces[i]));
    const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(n / 2);
    std::nth_element(sizes.begin(), middle, sizes.end());
    return n > 0 ? *middle : 0;
  }

  Domain domain_;
  Participant participant_;
  ScratchDirectory scratch_;
  std::string scene_ = two_on_a_cube(scratch_);
  ScriptedClient trainee_{participant_, 3}, mentor_{participant_, 5};
};

// Alone; with the mentor beside it; for both what one daemon with two devices has.
TEST_F(MentorDaemon, BothHandsFeelOneTissueAndWhoIsGoneIsOutOfIt) {
  double alone = 0, together = 0, mentors = 0;
  {
    auto whole = daemon({});
    ASSERT_TRUE(press(trainee_)) << log("daemon");
    pause(1000);
    alone = median(trainee_);
    ASSERT_TRUE(press(mentor_));
    pause(1000);
    together = median(trainee_);
    mentors = median(mentor_);
    ASSERT_LT(together, 0.97 * alone);  // each stands in the dent of the other
    trainee_.move_to(above_z, 100);
    mentor_.move_to(above_z, 100);
  }
  pause(1000);
  const std::uint32_t link = domain_.id() + 100;  // as over a network
  auto half = daemon({"--edge-devices", "5", "--edge-domain", std::to_string(link)});
  auto far = edge(link);
  ASSERT_TRUE(press(trainee_)) << log("daemon");
  pause(1000);
  EXPECT_NEAR(median(trainee_), alone, 0.02 * alone);
  ASSERT_TRUE(press(mentor_)) << log("edge") << log("daemon");
  pause(1000);
  EXPECT_NEAR(median(trainee_), together, 0.02 * together);
  EXPECT_NEAR(median(mentor_), mentors, 0.02 * mentors);

  // The mentor's edge dies: the trainee's force is that of one hand again, within the limits, never disarmed.
  const std::size_t from = trainee_.count();
  far->signal(SIGKILL);
  far->wait(5);
  EXPECT_TRUE(trainee_.await(
      1000, [&](const Force& f) { return std::abs(magnitude(f) - alone) < 0.02 * alone; }, from));
  pause(700);
  EXPECT_NEAR(median(trainee_), alone, 0.02 * alone);
  expect_bounded(trainee_.forces(from));
  for (const Force& f : trainee_.forces(from))
    ASSERT_FALSE(has(f, status_disarmed | status_latched)) << f.number;
  // Nobody else answers the mentor's device.
  pause(50);
  const std::size_t silent = mentor_.count();
  pause(300);
  EXPECT_EQ(mentor_.count(), silent);

  // Another edge has it.
  auto next = edge(link);
  ASSERT_TRUE(arm(mentor_)) << log("edge");
  EXPECT_TRUE(mentor_.await(patience_ms, felt)) << log("edge");
  pause(1000);
  EXPECT_NEAR(median(trainee_), together, 0.02 * together);
  expect_bounded(trainee_.forces(from));
  EXPECT_EQ(trainee_.strange_forces() + mentor_.strange_forces(), 0u);

  // The trainee's daemon dies: the mentor has the safety table.
  const std::size_t last = mentor_.count();
  half->signal(SIGKILL);
  ASSERT_TRUE(mentor_.await(
      patience_ms, [](const Force& f) { return has(f, status_problem_lost) && magnitude(f) == 0; }, last));
  expect_bounded(mentor_.forces(last));
  for (const Force& f : mentor_.forces(last)) {
    if (f.problem_age_ms >= 60 && f.problem_age_ms < 200) {
      EXPECT_TRUE(has(f, status_problem_old)) << f.problem_age_ms;
    }
    EXPECT_FALSE(has(f, status_latched)) << f.number;
  }
}

class GhostDaemon : public MentorDaemon {
 protected:
  GhostDaemon() { scene_ = two_on_a_cube(scratch_, "    ghost: {of: 5, stiffness: 100, max_force: 0.5}\n"); }
};

// The hands are 12 mm apart, and the mentor goes up by 5 mm.
TEST_F(GhostDaemon, GuidesWithinItsForceAndIsGoneWithTheMentor) {
  auto half = daemon({"--edge-devices", "5", "--no-tank"});
  auto far = edge();
  ASSERT_TRUE(arm(trainee_)) << log("daemon");
  EXPECT_EQ(magnitude(trainee_.forces().back()), 0);  // nobody is there
  ASSERT_TRUE(arm(mentor_)) << log("edge");
  EXPECT_TRUE(trainee_.await(patience_ms, [](const Force& f) { return std::abs(magnitude(f) - 0.5) < 1e-6; }))
      << magnitude(trainee_.forces().back());
  const Force first = trainee_.forces().back();
  EXPECT_GT(first.force[0], 0.49);  // towards it
  mentor_.move_to(above_z + 0.005, 200);
  pause(300);
  const Force up = trainee_.forces().back();
  EXPECT_NEAR(up.force[2] / up.force[0], 5.0 / 12, 0.02);
  EXPECT_NEAR(magnitude(up), 0.5, 1e-6);
  EXPECT_EQ(mentor_.await(100, [](const Force& f) { return magnitude(f) > 0; }), false);  // it has no ghost

  const std::size_t from = trainee_.count();
  far->signal(SIGKILL);
  EXPECT_TRUE(trainee_.await(
      1000, [](const Force& f) { return magnitude(f) == 0; }, from));
  const std::vector<Force> forces = trainee_.forces(from);
  expect_bounded(forces);
  std::size_t pulled = 0;
  for (const Force& f : forces) {
    ASSERT_LE(magnitude(f), 0.5 * (1 + 1e-6));
    ASSERT_FALSE(has(f, status_disarmed)) << f.number;
    pulled += magnitude(f) > 0;
  }
  EXPECT_LE(pulled, 100u);  // hands are lost after 60 ms, and a blend and the slew limit take a few more
}

TEST_F(MentorDaemon, WhoAnswersWhatMustAgree) {
  auto half = daemon({"--no-haptics"});
  auto far = edge();
  for (int i = 0; i < patience_ms && log("edge").find("--edge-devices") == std::string::npos; ++i) pause(1);
  EXPECT_NE(log("edge").find("--edge-devices"), std::string::npos) << log("edge");
  mentor_.enable(true);
  pause(500);
  for (const Force& f : mentor_.forces()) EXPECT_EQ(magnitude(f), 0);
}

TEST_F(MentorDaemon, FaultyOptionsAreNamed) {
  const CommandResult unknown = run_haptic("edge " + scene_ + " --devices 4");
  EXPECT_EQ(unknown.code, 2) << unknown.output;
  EXPECT_NE(unknown.output.find("--devices"), std::string::npos) << unknown.output;
  EXPECT_NE(unknown.output.find("4 is no instrument's device; there are: 3, 5"), std::string::npos)
      << unknown.output;
  const CommandResult domain = run_command(std::string(BIN_DIR) + "/hapticd " + scene_ +
                                           " --edge-devices 5 --domain 7 --edge-domain 7");
  EXPECT_EQ(domain.code, 2) << domain.output;
  EXPECT_NE(domain.output.find("--edge-domain"), std::string::npos) << domain.output;
  const CommandResult event = run_haptic("edge " + scene_ + " --devices 5 --mode event");
  EXPECT_EQ(event.code, 2) << event.output;
  EXPECT_NE(event.output.find("haptic.mode"), std::string::npos) << event.output;
}

}  // namespace
}  // namespace hapticd
