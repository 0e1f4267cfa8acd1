// An instrument at a pose: its gap is gap_at's, and `near` never denies what is within reach.
#include "physics/contact/placed_instrument.h"

#include <random>

#include <gtest/gtest.h>

namespace hapticd {
namespace {

std::mt19937 random_engine{7};
double uniform(double a, double b) { return std::uniform_real_distribution<double>(a, b)(random_engine); }
Vec3 anywhere(double size) { return {uniform(-size, size), uniform(-size, size), uniform(-size, size)}; }
Pose any_pose(double size) {
  Quat q(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
  return {anywhere(size), q.normalized()};
}

// Some of every shape; more than PlacedInstrument has places for where `many`.
Instrument any_instrument(bool many) {
  Instrument instrument;
  for (int k = 0; k < (many ? 20 : 4); ++k) {
    const Pose placement = any_pose(2e-3);
    if (k % 4 == 3) {
      std::vector<Vec3> corners;
      for (int i = 0; i < 8; ++i)
        corners.emplace_back(i & 1 ? 1e-3 : -1e-3, i & 2 ? 2e-3 : -2e-3, i & 4 ? 3e-3 : -3e-3);
      instrument.primitives.push_back(make_convex("box", corners, placement));
    } else {
      const Shape shapes[] = {Shape::sphere, Shape::capsule, Shape::cylinder};
      instrument.primitives.push_back(
          {"part", shapes[k % 4], uniform(0.5e-3, 2e-3), uniform(0.5e-3, 3e-3), placement, {}, {}});
    }
  }
  return instrument;
}

TEST(PlacedInstrument, ItsGapIsTheInstrumentsAndNearDeniesNothingWithinReach) {
  int denied = 0;
  for (int n = 0; n < 200; ++n) {
    const Instrument instrument = any_instrument(n % 5 == 0);
    const Pose X = any_pose(0.1);
    const PlacedInstrument placed(instrument, X);
    for (int i = 0; i < 200; ++i) {
      const Vec3 x = X.p + anywhere(8e-3);
      const Gap expected = gap_at(instrument, X, x), found = placed.gap(x);
      EXPECT_NEAR(found.distance, expected.distance, 1e-15);
      EXPECT_LT((found.normal - expected.normal).norm(), 1e-9);
      EXPECT_EQ(found.primitive, expected.primitive);
      for (const double reach : {-0.5e-3, 0.0, 1e-3}) {
        const bool near = placed.near(x, reach);
        EXPECT_TRUE(near || expected.distance >= reach) << expected.distance << " " << reach;
        denied += !near;
      }
    }
  }
  EXPECT_GT(denied, 10'000);  // it is worth asking
}

}  // namespace
}  // namespace hapticd
