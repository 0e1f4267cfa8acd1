// Blocks at rest, on an incline, and a wedge.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "tests/support/rubbing_worlds.h"
#include "tools/chart/pieces/piece_check.h"

namespace hapticd {
namespace {

constexpr double g = 9.81, h = 0.02;
constexpr double degree = std::numbers::pi / 180;

std::string cells_of(int n) { return std::to_string(n) + " cells high"; }

// Whose nodes are held against whose faces, and whether an instrument beside the stack, which touches
// nothing, keeps it awake.
struct StackCase {
  bool both_ways, kept_awake;
};

// Three soft blocks on one another and on a rigid floor, a little aside, the ground tilted by 3°, μ 0.4.
struct Stack {
  static constexpr double edge = 6e-3;
  std::unique_ptr<World> world;
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();
  StackCase as;

  Stack(int n, const StackCase& c) : as(c) {
    std::vector<BodySettings> bodies = {
        slab("floor", Vec3(0.02, 0.02, 4e-3), {4, 4, 1}, {Vec3(-7e-3, -7e-3, -4e-3), Quat::Identity()})};
    for (int k = 0; k < 3; ++k)
      bodies.push_back(block("block", Vec3(edge, edge, edge), {n, n, n}, {5e3, 0.4, 1000, 0, 2e-3},
                             {Vec3(3e-4 * k, 2e-4 * k, (edge + 1e-6) * k + 1e-6), Quat::Identity()}));
    WorldSettings s = contact_world({{1, 0, 0.4}, {2, 1, 0.4}, {3, 2, 0.4}});
    if (as.both_ways)
      for (const int below : {1, 2}) s.body_contact.pairs.push_back({below, below + 1, 0.4});
    s.gravity = g * Vec3(std::sin(3 * degree), 0, -std::cos(3 * degree));
    s.alarm_distance = 12e-3;
    world = std::make_unique<World>(std::move(bodies), ball(1e-3), s);
  }

  StepReport step() {
    const InstrumentSample sample = as.kept_awake ? at(Vec3(-4e-3, 3e-3, 9e-3)) : nobody();
    return world->step([&] { return sample; }, *problem);
  }
  std::vector<Vec3> places() const {
    std::vector<Vec3> out;
    for (int b = 1; b <= 3; ++b)
      out.insert(out.end(), world->bodies()[b].state.x.begin(), world->bodies()[b].state.x.end());
    return out;
  }
};

}  // namespace

void check_stack(Effort effort, TissueFindings& findings) {
  const bool quick = effort == Effort::quick;
  const double seconds = quick ? 4 : 60, settling = 2;
  for (const int n : quick ? std::vector{2} : std::vector{2, 3, 4})
    for (const StackCase& as : {StackCase{true, false}, StackCase{true, true}, StackCase{false, false}}) {
      if (quick && !as.both_ways) continue;
      Stack stack(n, as);
      for (int i = 0; i < settling / h; ++i) stack.step();
      const std::vector<Vec3> start = stack.places();
      double drift = 0;
      int slept = 0;
      for (int i = 0; i < seconds / h && drift < Stack::edge; ++i) {
        slept += stack.step().awake_bodies == 0;
        const std::vector<Vec3> x = stack.places();
        for (std::size_t k = 0; k < x.size(); ++k) drift = std::max(drift, (x[k] - start[k]).norm());
      }
      std::string name = "stack of three blocks, " + cells_of(n) + ", ";
      name += as.both_ways ? "pairs both ways" : "pairs one way";
      name += drift >= Stack::edge ? ", falls apart"
              : as.kept_awake      ? ", kept awake"
              : slept > 0          ? ", falls asleep"
                                   : ", does not fall asleep";
      name += ": drift in " + std::to_string(static_cast<int>(seconds)) + " s [um]";
      findings.check(name, 0, 1e6 * drift, 1, "statics");
    }
}

void check_incline(Effort effort, TissueFindings& findings) {
  const double mu = 0.4, limit = std::atan(mu), bracket = 0.05 * degree;
  const bool quick = effort == Effort::quick;
  for (const bool soft : {false, true})
    for (const int n : quick ? std::vector{2} : std::vector{2, 3, 5}) {
      const std::array<int, 3> cells = {2 * n - 1, 2 * n - 1, n};
      Incline below(limit - bracket, mu, soft, cells), above(limit + bracket, mu, soft, cells);
      for (int i = 0; i < 40; ++i) {
        below.step();
        above.step();
      }
      const double start = centre_of(below.body()).dot(below.down), v = above.speed();
      for (int i = 0; i < 50; ++i) {
        below.step();
        above.step();
      }
      const double crept = centre_of(below.body()).dot(below.down) - start;
      const double a = (above.speed() - v) / (50 * h);
      const double hand = g * (std::sin(limit + bracket) - mu * std::cos(limit + bracket));
      const std::string where =
          std::string("block on a ") + (soft ? "soft" : "rigid") + " incline, mu 0.4, " + cells_of(n);
      findings.check(where + ", 0.05 degrees below the friction angle: creep in 1 s [um]", 0,
                     1e6 * std::abs(crept), 1e-3, "statics");
      // A difference of two numbers four hundred times as large.
      findings.check(where + ", 0.05 degrees above it: acceleration [m/s2]", hand, a,
                     (soft ? 3e-5 : 1e-7) * g / hand, "Coulomb 1785");
    }
}

void check_wedge(Effort effort, TissueFindings& findings) {
  const double mu = 0.3;
  const bool quick = effort == Effort::quick;
  for (const bool locks : {true, false})
    for (const int n : quick ? std::vector{4} : std::vector{2, 4, 6}) {
      const double alpha = std::atan(mu) + (locks ? -3 : 3) * degree;
      Wedge wedge(alpha, mu, {n, std::max(2, n - 1), n});
      for (int i = 0; i < Wedge::steps; ++i) wedge.step();
      const std::string where = std::string("wedge 3 degrees ") + (locks ? "below" : "above") +
                                " the friction angle, " + cells_of(n);
      const Vec3 left = wedge.on_wall(0), right = wedge.on_wall(1);
      if (!locks) {
        findings.check(where + ": wall's force left when let go, of the largest", 0,
                       left.norm() / wedge.pressed, 1e-3, "statics");
        findings.check(where + ": wall's force under the load, sliding in", wedge.sliding_in(),
                       wedge.pressed / wedge.applied, 0.1, "statics; what is stuck may give more");
        continue;
      }
      findings.check(where + ": sum of the walls' forces when let go, of one", 0,
                     (left + right).norm() / left.norm(), 1e-3, "statics");
      const Vec3 start = centre_of(wedge.world->bodies()[0]);
      for (int i = 0; i < 1 / h; ++i) wedge.step();
      findings.check(where + ": motion in 1 s [um]", 0,
                     1e6 * (centre_of(wedge.world->bodies()[0]) - start).norm(), 1, "statics");
    }
}

}  // namespace hapticd
