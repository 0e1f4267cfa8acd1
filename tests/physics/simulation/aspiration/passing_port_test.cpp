// A port that passes over tissue draws it as with steps twenty times as short.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "tests/support/bodies.h"
#include "tests/support/suction_sheet.h"

namespace hapticd {
namespace {

constexpr double speed = 10e-3, time_of_pass = 0.2;  // [m/s], [s]

// Heights of a block's upper nodes above where they were, after the needle has passed over it with its port
// 0.08 mm above, in steps of h.
std::vector<double> drawn(double h) {
  std::vector<BodySettings> bodies;
  bodies.push_back(block("block", {4e-3, 2e-3, 1e-3}, {16, 8, 4}, {3e3, 0.4, 1000, 2, 2e-3},
                         {Vec3(-2e-3, -1e-3, -1e-3), Quat::Identity()}));
  for (int n = 0; n < std::ssize(bodies[0].mesh.nodes); ++n)
    if (bodies[0].mesh.nodes[n].z() < -1e-3 + 1e-9) bodies[0].fixed_nodes.push_back(n);
  WorldSettings s = contact_world({});
  s.h = h;
  s.alarm_distance = 0.3e-3;
  s.sample_spacing = 0.1e-3;
  s.coupling[0] = {50, 1e-3, 2e-3};
  World world(std::move(bodies), suction::needle(), s);
  const auto problem = std::make_unique<CondensedProblem>();
  InstrumentSample hand = at(Vec3::Zero());
  hand.aspiration = true;
  hand.vacuum = suction::vacuum;
  const int steps = static_cast<int>(std::lround(time_of_pass / h));
  for (int k = 1; k <= steps; ++k) {
    hand.pose.p = Vec3(-1e-3 + speed * h * k, 0, 0.08e-3);
    world.step([&] { return InstrumentSamples(hand); }, *problem);
  }
  std::vector<double> height;
  const Body& body = world.bodies()[0];
  for (std::size_t n = 0; n < body.state.x.size(); ++n)
    if (body.rest()[n].z() > -1e-9) height.push_back(body.state.x[n].z() - body.rest()[n].z());
  return height;
}

// Drawn by where tissue was when the step began, it would be off by two fifths.
TEST(PassingPort, DrawsAsWithShorterSteps) {
  const std::vector<double> fine = drawn(1e-3), coarse = drawn(20e-3);
  const double most = *std::max_element(fine.begin(), fine.end());
  double off = 0;
  for (std::size_t i = 0; i < fine.size(); ++i) off = std::max(off, std::abs(fine[i] - coarse[i]));
  ASSERT_GT(most, 20e-6);
  EXPECT_LT(off, 0.1 * most);
}

}  // namespace
}  // namespace hapticd
