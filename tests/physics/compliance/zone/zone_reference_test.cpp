// Reference factors of method zone, made elsewhere or late, and what the report says of them.
#include <gtest/gtest.h>

#include <stdexcept>
#include <thread>

#include "tests/physics/compliance/zone/zone_bench.h"

namespace hapticd {
namespace {

using namespace zone_bench;

TEST(ZoneCompliance, RemovalsWhileAReferenceIsMadeAreCarriedOver) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  const std::vector<int> next = oracle::nearest(model, Vec3(0, 0, 6e-3), 30);
  TissueState state = deformed(model, 9);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  remove(model, state, *compliance, {5, 200, 300});
  compliance->update(state);

  compliance->move_zone(next);
  auto reference = compliance->snapshot_reference(state);
  EXPECT_TRUE(compliance->zone_covers(zone));  // until it is adopted
  remove(model, state, *compliance, {6, 7, 201, 340, 350});
  compliance->update(state);
  expect_exact(model, state, *compliance, zone);
  std::thread([&] { reference->make(); }).join();
  compliance->adopt_reference(std::move(reference), state);
  EXPECT_TRUE(compliance->zone_covers(next));
  EXPECT_FALSE(compliance->zone_covers(zone));
  EXPECT_THROW(static_cast<void>(compliance->report()), std::runtime_error);  // no update yet
  compliance->update(state);
  expect_exact(model, state, *compliance, next);
  EXPECT_EQ(compliance->report().removed_since_reference, 5);
  EXPECT_EQ(compliance->report().reference_age, 1);
  // Once more, with the retired reference factor freed on the way.
  reference = compliance->snapshot_reference(state);
  reference->make();
  compliance->adopt_reference(std::move(reference), state);
  compliance->update(state);
  expect_exact(model, state, *compliance, next);
  EXPECT_EQ(compliance->report().removed_since_reference, 0);
}

TEST(ZoneCompliance, RefusesAReferenceThatIsNotMade) {
  const TissueModel model = box(2);
  const auto compliance = zone_method(model, {});
  const TissueState state = rest_state(model);
  EXPECT_THROW(compliance->adopt_reference(compliance->snapshot_reference(state), state),
               std::invalid_argument);
  EXPECT_THROW(compliance->adopt_reference(nullptr, state), std::invalid_argument);
  MatX block(3, 3);
  EXPECT_THROW(compliance->patch(std::vector<int>{20}, block), std::runtime_error);
  EXPECT_THROW(compliance->move_zone(std::vector<int>{27}), std::invalid_argument);
  compliance->update(state);
  EXPECT_THROW(compliance->patch(std::vector<int>{27}, block), std::invalid_argument);
}

TEST(ZoneCompliance, ANewReferenceAtTheSameStateChangesNothing) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  const TissueState state = deformed(model, 13);
  const auto compliance = zone_method(model, zone);
  compliance->update(state);
  MatX before(90, 90);
  compliance->patch(zone, before);
  auto reference = compliance->snapshot_reference(state);
  reference->make();
  compliance->adopt_reference(std::move(reference), state);
  compliance->update(state);
  MatX after(90, 90);
  compliance->patch(zone, after);
  EXPECT_LT((after - before).norm(), 1e-12 * before.norm());
}

// Past what may be carried, removals wait in the stale far field, and the report says so; unless the method
// may make a reference factor on the spot.
TEST(ZoneCompliance, WhatIsNotCarriedIsReported) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  const std::vector<int> tets = tets_where(model, zone, Where::outside);
  for (const bool synchronous : {false, true}) {
    ComplianceOptions options;
    options.most_carried = 8;
    options.synchronous_reference = synchronous;
    const auto compliance = zone_method(model, zone, options);
    TissueState state = deformed(model, 16);
    compliance->update(state);
    remove(model, state, *compliance, {tets.begin(), tets.begin() + 8});
    compliance->update(state);
    expect_exact(model, state, *compliance, zone);
    remove(model, state, *compliance, {tets.begin() + 8, tets.begin() + 12});
    compliance->update(state);
    if (synchronous) {
      expect_exact(model, state, *compliance, zone);
      EXPECT_EQ(compliance->report().removed_since_reference, 0);
    } else {
      EXPECT_GT(errors_of(model, state, *compliance, zone).apply, 1e-3);
      EXPECT_NE(compliance->report().health, ComplianceHealth::good);
      EXPECT_GT(compliance->report().residual, 1e-3);
    }
  }
}

// What is sampled only now and then is good only while nothing has moved since.
TEST(ZoneCompliance, HealthIsNeverOlderThanTheState) {
  const TissueModel model = box(3);
  const std::vector<int> zone = oracle::nearest(model, tip, 20);
  ComplianceOptions options;
  options.sample_every = 100;
  const auto compliance = zone_method(model, zone, options);
  TissueState state = rest_state(model);
  // Nothing is sampled in the step of a new reference factor, and a sample is spread over the two steps after
  // it.
  for (const ComplianceHealth expected :
       {ComplianceHealth::new_reference_wanted, ComplianceHealth::new_reference_wanted,
        ComplianceHealth::good, ComplianceHealth::good}) {
    compliance->update(state);
    EXPECT_EQ(compliance->report().health, expected);
  }
  state = deformed(model, 14);
  compliance->update(state);
  EXPECT_EQ(compliance->report().health, ComplianceHealth::new_reference_wanted);
}

}  // namespace
}  // namespace hapticd
