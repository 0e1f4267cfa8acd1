// Every method against a fresh inverse of A, while the mesh is cut and tetrahedra go.
#include <gtest/gtest.h>

#include "tests/physics/compliance/cut_by_hand.h"

namespace hapticd {
namespace {

using oracle::h;

struct Method {
  const char* name;
  ComplianceMethod method;
  Factorisation factorisation = Factorisation::multifrontal;
};

class CutCompliance : public testing::TestWithParam<Method> {
 protected:
  static std::unique_ptr<Compliance> make(const TissueModel& model) {
    ComplianceOptions options;
    options.factorisation = GetParam().factorisation;
    return make_compliance(GetParam().method, model, h, options);
  }
};

TEST_P(CutCompliance, AgreesWithAFreshInverse) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    TissueModel model = by_hand::box_with_room(3, {70, 300});
    TissueState state = rest_state(model);
    const auto compliance = make(model);
    compliance->move_zone(oracle::nearest(model, oracle::size, 20));
    compliance->update(state);
    int cuts = 0;
    for (int step = 0; step < 60; ++step) {
      if (step % 7 == 3) {
        const int gone = static_cast<int>(random() % model.tets_in_use);
        remove_tets(model, state, std::span(&gone, 1));
        compliance->remove(state, std::span(&gone, 1));
      }
      cuts +=
          !by_hand::cut_at(model, state, *compliance, static_cast<int>(random() % model.nodes_in_use), random)
               .empty();
      if (step % 4 != 0) continue;
      const std::vector<int> zone = oracle::nearest(model, oracle::size, 25);
      compliance->move_zone(zone);
      compliance->update(state);
      const MatX C = oracle::inverse(model, state);
      ASSERT_LT(oracle::apply_error(*compliance, C), 1e-10) << step;
      ASSERT_LT(oracle::patch_error(*compliance, C, zone), 1e-10) << step;
    }
    EXPECT_GT(cuts, 25);
    compliance->update(state);
    EXPECT_LE(compliance->report().residual, 1e-9);
  }
}

// References made before, between and after cuts, and adopted after more of them.
TEST_P(CutCompliance, AReferenceOfAnOlderMeshIsNoHarm) {
  for (unsigned seed = 5; seed <= 7; ++seed) {
    std::mt19937 random(seed);
    TissueModel model = by_hand::box_with_room(3, {70, 300});
    TissueState state = rest_state(model);
    const auto compliance = make(model);
    ReferenceCompliance* const references = as_reference_compliance(compliance.get());
    if (!references) GTEST_SKIP() << "keeps no reference factor";
    const std::vector<int> zone = oracle::nearest(model, oracle::size, 20);
    compliance->move_zone(zone);
    compliance->update(state);
    const auto cut = [&](int count) {
      for (int k = 0; k < count; ++k) {
        by_hand::cut_at(model, state, *compliance, static_cast<int>(random() % model.nodes_in_use), random);
        if (k % 3 != 0) continue;
        const int gone = static_cast<int>(random() % model.tets_in_use);
        remove_tets(model, state, std::span(&gone, 1));
        compliance->remove(state, std::span(&gone, 1));
      }
    };
    const auto expect_right = [&] {
      compliance->update(state);
      const MatX C = oracle::inverse(model, state);
      EXPECT_LT(oracle::apply_error(*compliance, C), 1e-10);
      EXPECT_LT(oracle::patch_error(*compliance, C, zone), 1e-10);
    };
    for (int round = 0; round < 4; ++round) {
      SCOPED_TRACE(round);
      auto reference = references->snapshot_reference(state);
      cut(4);
      expect_right();
      reference->make();
      cut(3);
      references->adopt_reference(std::move(reference), state);
      expect_right();
      cut(2);
      expect_right();
    }
  }
}

// Planned room that no cut has taken changes nothing, to the last bit.
TEST_P(CutCompliance, SpareRoomChangesNothing) {
  const TissueModel plain = by_hand::box_with_room(3, {});
  const TissueModel roomy = by_hand::box_with_room(3, {50, 90});
  const std::vector<int> zone = oracle::nearest(plain, oracle::size, 20);
  ASSERT_EQ(zone, oracle::nearest(roomy, oracle::size, 20));
  const VecX b = oracle::load(3 * plain.node_count());
  MatX blocks[2];
  VecX ys[2];
  for (const TissueModel* model : {&plain, &roomy}) {
    const int k = model == &roomy;
    TissueState state = oracle::deformed(*model, 3);
    const auto compliance = make(*model);
    compliance->move_zone(zone);
    compliance->update(state);
    const std::vector<int> gone = {3, 77, 150};
    remove_tets(*model, state, gone);
    compliance->remove(state, gone);
    compliance->update(state);
    VecX wide = VecX::Zero(3 * model->node_count());
    wide.head(b.size()) = b;
    compliance->apply(wide, wide);
    EXPECT_EQ(wide.tail(wide.size() - b.size()).norm(), 0);
    ys[k] = wide.head(b.size());
    blocks[k].resize(60, 60);
    compliance->patch(zone, blocks[k]);
  }
  EXPECT_EQ(ys[0], ys[1]);
  EXPECT_EQ(blocks[0], blocks[1]);
}

INSTANTIATE_TEST_SUITE_P(Compliance, CutCompliance,
                         testing::Values(Method{"exact", ComplianceMethod::exact},
                                         Method{"cholmod", ComplianceMethod::exact, Factorisation::cholmod},
                                         Method{"zone", ComplianceMethod::zone},
                                         Method{"updown", ComplianceMethod::updown},
                                         Method{"lazy", ComplianceMethod::lazy},
                                         Method{"dense", ComplianceMethod::dense}),
                         [](const auto& tested) { return std::string(tested.param.name); });

}  // namespace
}  // namespace hapticd
