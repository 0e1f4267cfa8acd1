// Method zone against a dense inverse: exact while nothing has moved since the reference factor, whatever
// went.
#include <gtest/gtest.h>

#include <numeric>

#include "tests/physics/compliance/zone/zone_bench.h"

namespace hapticd {
namespace {

using namespace zone_bench;

TEST(ZoneCompliance, IsExactAtItsReferenceForAnyZone) {
  const TissueModel model = box(3);
  const TissueState state = deformed(model, 3);
  for (const int count : {0, 1, 7, 20, 47, 48}) {
    const std::vector<int> zone = oracle::nearest(model, tip, count);
    const auto compliance = zone_method(model, zone);
    compliance->update(state);
    EXPECT_TRUE(compliance->zone_covers(zone));
    expect_exact(model, state, *compliance, zone);
    // Nodes outside the zone are given too, mixed with fixed ones.
    expect_exact(model, state, *compliance, {5, 20, 33, 47, 48, 63});
    EXPECT_LT(compliance->report().rotation_since_reference, 1e-7);
  }
}

TEST(ZoneCompliance, RemovalAnywhereIsExactWhileNothingMoved) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  for (const Where where : {Where::inside, Where::across, Where::outside}) {
    TissueState state = deformed(model, 5);
    const auto compliance = zone_method(model, zone);
    compliance->update(state);
    const std::vector<int> tets = tets_where(model, zone, where);
    ASSERT_GT(tets.size(), 15u);
    // One by one, then a batch.
    for (int i = 0; i < 5; ++i) remove(model, state, *compliance, {tets[i]});
    compliance->update(state);
    expect_exact(model, state, *compliance, zone);
    remove(model, state, *compliance, {tets.begin() + 5, tets.begin() + 15});
    compliance->update(state);
    expect_exact(model, state, *compliance, zone);
    EXPECT_EQ(compliance->report().removed_since_reference, 15);
    // A patch across the zone's edge, with the terms.
    std::vector<int> wide = oracle::nearest(model, tip, 45);
    wide.erase(wide.begin(), wide.begin() + 20);
    expect_exact(model, state, *compliance, wide);
  }
}

// A halo changes no result: it is out of the zone.
TEST(ZoneCompliance, TheHaloIsOutsideAndRight) {
  const TissueModel model = box(4);
  std::vector<int> near = oracle::nearest(model, tip, 60);
  const std::vector<int> zone(near.begin(), near.begin() + 20), halo(near.begin() + 20, near.end());
  TissueState state = deformed(model, 8);
  const auto compliance = zone_method(model, zone);
  compliance->move_halo(halo);
  compliance->update(state);
  EXPECT_TRUE(compliance->zone_covers(zone));
  EXPECT_FALSE(compliance->zone_covers(std::vector<int>{halo[0]}));
  expect_exact(model, state, *compliance, zone);
  expect_exact(model, state, *compliance, near);
  remove(model, state, *compliance, {tets_where(model, zone, Where::outside)[0]});
  compliance->update(state);
  expect_exact(model, state, *compliance, near);
}

TEST(ZoneCompliance, UntoldRemovalsAreFound) {
  const TissueModel model = box(3);
  const std::vector<int> zone = oracle::nearest(model, tip, 12);
  TissueState state = rest_state(model);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  remove_tets(model, state, std::vector<int>{1, 80, 120, 150});
  compliance->update(state);
  expect_exact(model, state, *compliance, zone);
}

// What is thin when the reference factor is made, and what becomes thin inside the zone; gone at last.
TEST(ZoneCompliance, ThinTissueIsExact) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  TissueState state = deformed(model, 5);
  const auto thin = [&](Where where, double left) {
    const std::vector<int> tets = tets_where(model, zone, where);
    std::vector<Thinned> thinned;
    for (int i = 0; i < 8; ++i) thinned.push_back({tets[i], left / (1 + i)});
    thin_tets(model, state, thinned);
    return std::vector<int>(tets.begin(), tets.begin() + 8);
  };
  const std::vector<int> inside = thin(Where::inside, 0.9), across = thin(Where::across, 0.8),
                         outside = thin(Where::outside, 0.7);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  expect_exact(model, state, *compliance, zone);
  thin(Where::inside, 0.1);
  compliance->update(state);
  expect_exact(model, state, *compliance, zone);
  for (const std::vector<int>& tets : {inside, across, outside}) {
    remove(model, state, *compliance, tets);
    compliance->update(state);
    expect_exact(model, state, *compliance, zone);
  }
}

TEST(ZoneCompliance, OrphansInAndOutOfTheZone) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  const auto around = [&](int node) {
    std::vector<int> tets;
    for (int t = 0; t < model.tet_count(); ++t)
      for (const int n : model.mesh.tets[t])
        if (n == node) tets.push_back(t);
    return tets;
  };
  TissueState state = deformed(model, 6);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  const int outside = oracle::nearest(model, Vec3(0, 0, 2e-3), 1).front();
  for (const int node : {zone[0], zone[29], outside}) {
    SCOPED_TRACE(node);
    // One element at a time: the last one leaves an orphan.
    for (const int t : around(node)) remove(model, state, *compliance, {t});
    ASSERT_EQ(state.live_tets_of_node[node], 0);
    compliance->update(state);
    expect_exact(model, state, *compliance, zone);
  }
}

TEST(ZoneCompliance, ABodyCutInTwoAndAFragmentSuckedOut) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  TissueState state = deformed(model, 7);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  // The layer of cells below the top one goes: the top floats, partly in the zone and partly out of it.
  std::vector<int> layer(96);
  std::iota(layer.begin(), layer.end(), 2 * 96);
  remove(model, state, *compliance, layer);
  compliance->update(state);
  expect_exact(model, state, *compliance, zone, 1e-9);
  const ComplianceReport cut = compliance->report();
  std::vector<int> top(96);
  std::iota(top.begin(), top.end(), 3 * 96);
  remove(model, state, *compliance, top);
  compliance->update(state);
  expect_exact(model, state, *compliance, zone, 1e-9);
  EXPECT_TRUE(cut.wants_reference);  // the cut is carried
  // A fragment that goes whole adds no terms.
  EXPECT_EQ(compliance->report().memory_bytes, cut.memory_bytes);
}

TEST(ZoneCompliance, CutToNothingMovesNothing) {
  const TissueModel model = box(3);
  std::vector<int> all(model.tet_count());
  std::iota(all.begin(), all.end(), 0);
  std::mt19937 random(8);
  std::shuffle(all.begin(), all.end(), random);
  TissueState state = deformed(model, 8);
  const std::vector<int> zone = oracle::nearest(model, tip, 20);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  VecX y(3 * model.node_count());
  for (std::size_t i = 0; i < all.size(); i += 9) {
    remove(model, state, *compliance, {all.begin() + i, all.begin() + i + 9});
    compliance->update(state);
    // Pieces of one element float by now; the terms carry them all.
    expect_exact(model, state, *compliance, zone, 1e-8);
  }
  compliance->apply(VecX::Ones(y.size()), y);
  EXPECT_EQ(y.norm(), 0);
}

TEST(ZoneCompliance, QuantisedReferenceGivesTheSamePatch) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  ComplianceOptions options;
  options.quantised_reference = true;
  const auto compliance = zone_method(model, zone, options);
  TissueState state = deformed(model, 15);
  compliance->update(state);
  remove(model, state, *compliance, {1, 2, 3, 301, 302});
  compliance->update(state);
  const Errors errors = errors_of(model, state, *compliance, zone);
  EXPECT_LT(errors.patch, 1e-10);
  EXPECT_LT(errors.apply, 5e-4);
  EXPECT_GT(errors.apply, 1e-12);
}

}  // namespace
}  // namespace hapticd
