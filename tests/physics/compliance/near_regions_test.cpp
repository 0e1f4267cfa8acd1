// Near regions that are condensed one from another, against those that are condensed at once.
#include "physics/compliance/near_regions.h"

#include <gtest/gtest.h>

#include "physics/tissue/tissue_parts.h"
#include "tests/physics/compliance/oracle.h"

namespace hapticd {
namespace {

const NearRegion first{Vec3(oracle::size.x() / 2, oracle::size.y() / 2, oracle::size.z()), 3.2e-3};

const Vec3 gravity(1, 2, -9.81);

// Held at its bottom; there a stretched region and springs.
std::shared_ptr<const TissueModel> tissue() {
  TissueModel model = oracle::box(8);
  model.gravity = gravity;
  TissueRegion region{{}, {9000, 0.3, 1200}, Vec3(1.1, 0.95, 1.02)};
  std::vector<NodeSpring> springs(model.mesh.nodes.size());
  for (int t = 0; t < model.tet_count(); ++t)
    if (model.mesh.nodes[model.mesh.tets[t][0]].z() < 0.2 * oracle::size.z()) region.tets.push_back(t);
  set_region(model, region);
  for (int n = 0; n < model.node_count(); ++n)
    if (const Vec3& x = model.mesh.nodes[n]; x.x() < 1e-9) springs[n] = {20, x + Vec3(1e-4, 0, -2e-4)};
  set_springs(model, springs);
  return std::make_shared<const TissueModel>(std::move(model));
}

// The same at once. A part that no face joins to the rest may be held by what was condensed before, which is
// not there yet where all is condensed at once: then it is near there. Such places are left out.
std::shared_ptr<const CondensedTissue> at_once(const TissueModel& model, const NearRegions& regions,
                                               int region, std::span<const int> gone) {
  TissueState state = rest_state(model);
  for (const int t : gone) state.alive[t] = 0;
  return condense(model, state, tets_within(model, {regions.place(region), regions.radius()}));
}

void expect_same(const CondensedTissue& a, const CondensedTissue& b) {
  ASSERT_EQ(a.node, b.node);
  EXPECT_EQ(a.near_node, b.near_node);
  EXPECT_EQ(a.near_tet, b.near_tet);
  EXPECT_EQ(a.tet, b.tet);
  EXPECT_EQ(a.place, b.place);
  EXPECT_LT(oracle::relative(*a.stiffness, *b.stiffness), 1e-9);
  // Lumped in several steps, the mass is another; what the tissue weighs is not.
  double sum_a = 0, sum_b = 0;
  VecX weight_a = a.load, weight_b = b.load;
  for (std::size_t i = 0; i < a.mass.size(); ++i) {
    weight_a.segment<3>(3 * static_cast<Eigen::Index>(i)) += a.mass[i] * gravity;
    weight_b.segment<3>(3 * static_cast<Eigen::Index>(i)) += b.mass[i] * gravity;
    sum_a += a.mass[i];
    sum_b += b.mass[i];
  }
  EXPECT_LT((weight_a - weight_b).norm(), 1e-9 * weight_b.norm());
  EXPECT_NEAR(sum_a, sum_b, 0.2 * sum_b);
}

TEST(NearRegions, EachIsAsCondensedAtOnce) {
  const auto model = tissue();
  NearRegions regions(model, first);
  ASSERT_GT(regions.count(), 50);
  EXPECT_EQ(regions.place(regions.nearest(first.centre)), first.centre);
  int compared = 0;
  for (int region = 0; region < regions.count(); region += 5) {
    const auto far = regions.make(region, {});
    const auto expected = at_once(*model, regions, region, {});
    ASSERT_EQ(far != nullptr, expected != nullptr) << region;
    if (!far || far->near_tet != expected->near_tet) continue;
    ++compared;
    expect_same(*far, *expected);
    ASSERT_FALSE(HasFailure()) << region;
  }
  EXPECT_GT(compared, 20);
}

TEST(NearRegions, ANeighbourCostsLittleMore) {
  NearRegions regions(tissue(), first);
  ASSERT_TRUE(regions.make(regions.nearest(first.centre), {}));
  const int chain = regions.hulls_made();
  EXPECT_GE(chain, 4);
  int neighbours = 0;
  for (int region = 0; region < regions.count(); ++region) {
    if ((regions.place(region) - first.centre).norm() > 2.1 * regions.spacing()) continue;
    ++neighbours;
    ASSERT_TRUE(regions.make(region, {}));
  }
  EXPECT_GT(neighbours, 15);
  EXPECT_LT(regions.hulls_made() - chain, 0.75 * chain * neighbours);
}

TEST(NearRegions, WhatWentIsGoneFromAllRegions) {
  const auto model = tissue();
  NearRegions regions(model, first);
  const int here = regions.nearest(first.centre);
  const auto before = regions.make(here, {});
  ASSERT_TRUE(before);
  std::vector<int> near_gone(before->near_tet.begin(), before->near_tet.begin() + 5), gone = near_gone;
  // Near the place alone: what is far from it is as it was.
  const int made = regions.hulls_made();
  const auto same = regions.make(here, gone);
  EXPECT_EQ(regions.hulls_made(), made + 1);  // the last, which is not kept
  expect_same(*same, *at_once(*model, regions, here, gone));
  // And far from it.
  for (int t = 0; t < model->tet_count() && gone.size() < 12; ++t)
    if (before->tet[t] && model->mesh.nodes[model->mesh.tets[t][0]].z() > 0.6 * oracle::size.z())
      gone.push_back(t);
  ASSERT_EQ(gone.size(), 12u);
  int compared = 0;
  for (int region = 0; region < regions.count(); region += 7) {
    const auto far = regions.make(region, gone);
    const auto expected = at_once(*model, regions, region, gone);
    ASSERT_EQ(far != nullptr, expected != nullptr) << region;
    if (!far || far->near_tet != expected->near_tet) continue;
    ++compared;
    expect_same(*far, *expected);
    ASSERT_FALSE(HasFailure()) << region;
  }
  EXPECT_GT(compared, 20);
}

TEST(NearRegions, KeepToTheirMemory) {
  const auto model = tissue();
  NearRegions regions(model, first, 2'000'000), all(model, first);
  for (int region = 0; region < regions.count(); region += 9) {
    const auto far = regions.make(region, {}), same = all.make(region, {});
    EXPECT_LE(regions.memory_bytes(), 2'000'000u);
    ASSERT_EQ(far != nullptr, same != nullptr);
    if (far) expect_same(*far, *same);
  }
  EXPECT_GT(regions.hulls_made(), all.hulls_made());
}

}  // namespace
}  // namespace hapticd
