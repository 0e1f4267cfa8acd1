// A world that begins from another's bodies goes on as that one does.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "physics/tissue/fragments.h"
#include "tests/support/bodies.h"

namespace hapticd {
namespace {

constexpr double size = 10e-3;

// A bar that hangs by its end at x = 0 and parts at its middle, and a ball that may press on its side.
struct HangingBar {
  std::unique_ptr<World> world;
  std::unique_ptr<CondensedProblem> problem = std::make_unique<CondensedProblem>();

  static BodySettings bar() {
    BodySettings b = block("bar", {4 * size, size, size}, {8, 2, 2}, {2e4, 0.3, 1000, 1, 1e-3});
    for (int n = 0; n < static_cast<int>(b.mesh.nodes.size()); ++n)
      if (b.mesh.nodes[n].x() < 1e-9) b.fixed_nodes.push_back(n);
    b.removable = true;
    b.room = {100, 0};
    b.toughness = 1e-6;
    b.tearing = {.toughness = 1e-6, .begins = true};
    b.tearing.clefts.assign(4 * b.mesh.tets.size(), 0);
    for (std::size_t id = 0; id < b.tearing.clefts.size(); ++id) {
      const Triangle n = outward_face(b.mesh.tets[id / 4], static_cast<int>(id % 4));
      b.tearing.clefts[id] = std::all_of(
          n.begin(), n.end(), [&](int k) { return std::abs(b.mesh.nodes[k].x() - 2 * size) < 1e-9; });
    }
    return b;
  }
  static WorldSettings settings() {
    WorldSettings s = contact_world({});
    s.gravity = Vec3(9.81, 0, 0);
    return s;
  }

  explicit HangingBar(BodySettings b) {
    std::vector<BodySettings> bodies;
    bodies.push_back(std::move(b));
    world = std::make_unique<World>(std::move(bodies), ball(3e-3), settings());
  }
  StepReport step(const InstrumentSample& sample) {
    return world->step([&] { return InstrumentSamples(sample); }, *problem);
  }
  const Body& body() const { return world->bodies()[0]; }

  // The bar as it stands, in a world of its own.
  HangingBar begun() const {
    BodySettings b = bar();
    b.start = start_of(body());
    return HangingBar(std::move(b));
  }
};

double apart(const Body& a, const Body& b) {
  double most = 0;
  for (std::size_t n = 0; n < a.state.x.size(); ++n)
    most = std::max(most, (a.state.x[n] - b.state.x[n]).norm());
  return most;
}

// Torn in two and with holes: one half falls, the other swings back.
TEST(BodyStart, GoesOnAsTheWorldThatItWasTakenFrom) {
  HangingBar first(HangingBar::bar());
  for (int i = 0; i < 30; ++i) {
    if (i == 5) first.world->schedule_removal(0, {3, 7, 100});
    first.step(nobody());
  }
  ASSERT_EQ(find_pieces(first.body().model, first.body().state).count(), 2);
  ASSERT_EQ(first.body().state.removed, 3);
  ASSERT_GT(first.body().topology, 0);
  HangingBar second = first.begun();
  EXPECT_EQ(apart(first.body(), second.body()), 0);
  for (int i = 0; i < 10; ++i) {
    if (i == 5) {
      first.world->schedule_removal(0, {40});
      second.world->schedule_removal(0, {40});
    }
    first.step(nobody());
    second.step(nobody());
    // Factors in another order round otherwise.
    ASSERT_LT(apart(first.body(), second.body()), 1e-9 * size) << i;
    ASSERT_EQ(first.body().state.mass, second.body().state.mass) << i;
  }
  EXPECT_EQ(second.body().state.removed, 4);
  ASSERT_EQ(first.body().surface.faces().size(), second.body().surface.faces().size());
  for (std::size_t f = 0; f < first.body().surface.faces().size(); ++f)
    EXPECT_EQ(first.body().surface.faces()[f].id, second.body().surface.faces()[f].id);
}

// Without friction a contact remembers but where its linearisations begin, to what three of them leave.
TEST(BodyStart, APressedBodyGoesOnUnderTheSameForce) {
  BodySettings whole = HangingBar::bar();
  whole.tearing = {};
  HangingBar first(std::move(whole));
  const InstrumentSample pressing = at(Vec3(3.2 * size, 0.5 * size, size + 3e-3 - 1e-3));
  for (int i = 0; i < 5; ++i) first.step(pressing);
  HangingBar second = first.begun();
  for (int i = 0; i < 5; ++i) {
    const Vec6 a = first.step(pressing).contact.wrench[0], b = second.step(pressing).contact.wrench[0];
    ASSERT_GT(a.head<3>().norm(), 1e-3);
    ASSERT_LT((a - b).head<3>().norm(), 1e-3 * a.head<3>().norm()) << i;
    ASSERT_LT(apart(first.body(), second.body()), 1e-3 * 1e-3) << i << ": of the millimetre pressed";
  }
}

TEST(BodyStart, IsCutAndTornNoFurther) {
  HangingBar first(HangingBar::bar());
  HangingBar second = first.begun();
  for (int i = 0; i < 30; ++i) second.step(nobody());
  EXPECT_EQ(find_pieces(second.body().model, second.body().state).count(), 1);
  EXPECT_EQ(second.body().topology, 0);
}

TEST(BodyStart, ARigidBodyHasNone) {
  HangingBar first(HangingBar::bar());
  BodySettings b = slab("slab", {size, size, size}, {1, 1, 1});
  b.start = start_of(first.body());
  EXPECT_THROW(HangingBar(std::move(b)), std::invalid_argument);
}

}  // namespace
}  // namespace hapticd
