// Two free blocks, one thrown at the other: no force but theirs on one another.
#include <algorithm>
#include <memory>
#include <string>

#include "tests/support/bodies.h"
#include "tools/chart/pieces/piece_check.h"

namespace hapticd {
namespace {

constexpr double size = 6e-3;

Vec3 momentum(const World& world) {
  Vec3 sum = Vec3::Zero();
  for (const Body& b : world.bodies()) sum += mass_of(b) * velocity_of(b);
  return sum;
}

struct Impact {
  double momentum = 0, third_law = 0;  // largest change; largest sum of forces: relative
  double sent_on = 0;                  // the struck one's share of the momentum, in the end
  int touching = 0;                    // steps
};

// The ball throws the first and is gone; then it meets the second, aside by a sixth of its size.
Impact throw_at_another(int n, double mu) {
  const auto cube = [&](const char* name, const Vec3& p, int cells) {
    return block(name, Vec3(size, size, size), {cells, cells, cells}, {10e3, 0.4, 1000, 0, 2e-3},
                 {p, Quat::Identity()});
  };
  World world({cube("thrown", Vec3::Zero(), n), cube("struck", Vec3(size + 3e-3, 1e-3, 5e-4), n + 1)},
              ball(2e-3), contact_world({{0, 1, mu}, {1, 0, mu}}));
  const auto problem = std::make_unique<CondensedProblem>();
  const double speed = 20e-3, h = 0.02;
  for (int i = 0; i < 8; ++i)
    world.step([&] { return at(Vec3(-2.2e-3 + std::min(1.0, i / 5.0) * speed * h * i, 2.9e-3, 3.1e-3)); },
               *problem);
  world.step([] { return nobody(); }, *problem);
  const Vec3 before = momentum(world);
  Impact out;
  for (int i = 0; i < 60; ++i) {
    world.step([] { return nobody(); }, *problem);
    const Vec3 a = world.contacts().force_on(0), b = world.contacts().force_on(1);
    if (!a.isZero(0)) {
      ++out.touching;
      out.third_law = std::max(out.third_law, (a + b).norm() / a.norm());
    }
    out.momentum = std::max(out.momentum, (momentum(world) - before).norm() / before.norm());
  }
  const Body& struck = world.bodies()[1];
  out.sent_on = (mass_of(struck) * velocity_of(struck)).dot(before) / before.squaredNorm();
  return out;
}

}  // namespace

void check_impact(Effort effort, TissueFindings& findings) {
  for (const double mu : {0.0, 0.4})
    for (const int n : effort == Effort::quick ? std::vector{2} : std::vector{2, 3, 5}) {
      const Impact r = throw_at_another(n, mu);
      const std::string name =
          "two-body impact, mu " + std::string(mu > 0 ? "0.4" : "0") + ", " + std::to_string(n) + " cells: ";
      if (r.touching == 0 || r.sent_on < 0.1) {
        findings.skipped.push_back(name + "they did not meet");
        continue;
      }
      findings.check(name + "change of the momentum, relative", 0, r.momentum, 1e-9, "Newton 1687");
      findings.check(name + "sum of the forces, relative", 0, r.third_law, 1e-9, "Newton 1687");
    }
}

}  // namespace hapticd
