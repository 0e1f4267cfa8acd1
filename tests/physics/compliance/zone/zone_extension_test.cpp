// Nodes from outside join the zone of a reference factor that is there.
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "tests/physics/compliance/zone/zone_bench.h"

namespace hapticd {
namespace {

using namespace zone_bench;

std::vector<int> outside_of(const TissueModel& model, const std::vector<int>& zone) {
  std::vector<int> nodes;
  for (int n = 0; n < model.node_count(); ++n)
    if (!model.fixed[n] && std::ranges::find(zone, n) == zone.end()) nodes.push_back(n);
  std::mt19937 random(23);
  std::shuffle(nodes.begin(), nodes.end(), random);
  return nodes;
}

// Between removals that were carried before and others after, next to one another and far apart.
TEST(ZoneExtension, IsExactWhateverWentBeforeAndAfter) {
  const TissueModel model = box(4);
  const std::vector<int> near = oracle::nearest(model, tip, 45);
  const std::vector<int> zone(near.begin(), near.begin() + 30), halo(near.begin() + 30, near.end());
  const std::vector<int> joining = outside_of(model, zone);
  for (const bool with_halo : {false, true}) {
    TissueState state = deformed(model, 31);
    const auto compliance = zone_method(model, zone);
    if (with_halo) compliance->move_halo(halo);
    compliance->update(state);
    std::vector<int> covered = zone;
    for (int k = 0; k < 5; ++k) {
      remove(model, state, *compliance, {7 + 31 * k, 90 + 13 * k, 200 + 7 * k});
      const std::vector<int> some(joining.begin() + 6 * k, joining.begin() + 6 * (k + 1));
      compliance->extend_zone(some);
      compliance->extend_zone(std::vector<int>{some[0], zone[0]});  // asked for twice, there already
      EXPECT_FALSE(compliance->zone_covers(some));
      compliance->update(state);
      EXPECT_TRUE(compliance->zone_covers(some));
      EXPECT_TRUE(compliance->forward_covers(some));
      EXPECT_EQ(compliance->report().taken_in_since_reference, 6 * (k + 1));
      covered.insert(covered.end(), some.begin(), some.end());
      expect_exact(model, state, *compliance, covered);
      std::vector<int> wide = {8, 30, 55, 90};
      wide.insert(wide.end(), covered.end() - 3, covered.end());
      expect_exact(model, state, *compliance, wide);
    }
  }
}

// Elements that have all their nodes in it are fresh from then on, as those of the zone are.
TEST(ZoneExtension, TurnsWhatIsInside) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30), wide = oracle::nearest(model, tip, 60);
  ComplianceOptions options;
  options.warping = Warping::none;
  options.sample_every = 1 << 30;
  const auto compliance = zone_method(model, zone, options);
  TissueState state = deformed(model, 32);
  compliance->update(state);
  const std::vector<Mat3> reference = state.rotation;
  compliance->extend_zone(wide);
  state = deformed(model, 33, 4e-4);
  compliance->update(state);
  TissueState mixed = state;
  int fresh = 0;
  for (int t = 0; t < model.tet_count(); ++t)
    if (oracle::where(model, wide, t) != Where::inside)
      mixed.rotation[t] = reference[t];
    else
      fresh += oracle::where(model, zone, t) != Where::inside;
  EXPECT_GT(fresh, 20);
  const Errors errors = errors_of(model, mixed, *compliance, wide);
  EXPECT_LT(errors.patch, 1e-10);
  EXPECT_LT(errors.apply, 1e-10);
}

// A node that has lost all its tetrahedra does not join; one that joined may lose them afterwards.
TEST(ZoneExtension, OrphansAmongThem) {
  const TissueModel model = box(3);
  const std::vector<int> zone = oracle::nearest(model, tip, 12);
  const auto compliance = zone_method(model, zone);
  TissueState state = deformed(model, 34);
  compliance->update(state);
  const std::vector<int> joining = outside_of(model, zone);
  const auto star = [&](int n) {
    std::vector<int> tets;
    for (int t = 0; t < model.tet_count(); ++t)
      if (state.alive[t] && std::ranges::count(model.mesh.tets[t], n) > 0) tets.push_back(t);
    return tets;
  };
  remove(model, state, *compliance, star(joining[0]));  // before it is asked for: it does not join
  compliance->extend_zone(std::vector<int>{joining[0], joining[1], joining[2], joining[3]});
  compliance->update(state);
  EXPECT_EQ(compliance->report().taken_in_since_reference, 3);
  remove(model, state, *compliance, star(joining[1]));
  compliance->update(state);
  std::vector<int> wide = zone;
  wide.insert(wide.end(), joining.begin(), joining.begin() + 4);
  expect_exact(model, state, *compliance, wide);
}

TEST(ZoneExtension, HasALimit) {
  const TissueModel model = box(4);
  const std::vector<int> zone = oracle::nearest(model, tip, 30);
  ComplianceOptions options;
  options.most_taken_in = 8;
  options.synchronous_reference = false;
  const auto compliance = zone_method(model, zone, options);
  TissueState state = deformed(model, 35);
  compliance->update(state);
  EXPECT_FALSE(compliance->report().wants_reference);
  compliance->extend_zone(outside_of(model, zone));
  compliance->update(state);
  EXPECT_EQ(compliance->report().taken_in_since_reference, 8);
  EXPECT_TRUE(compliance->report().wants_reference);
  expect_exact(model, state, *compliance, zone);
}

}  // namespace
}  // namespace hapticd
