// What a cut changes of A, as two products of few columns.
#include <gtest/gtest.h>

#include "physics/compliance/zone/shape_change.h"
#include "tests/physics/compliance/cut_by_hand.h"

namespace hapticd {
namespace {

MatX dense(const TissueModel& model, const TissueState& state) {
  MatX A = MatX(assemble_system_matrix(model, state, oracle::h));
  for (int n = 0; n < model.node_count(); ++n)
    if (!oracle::in_system(model, state, n)) A.block<3, 3>(3 * n, 3 * n).setZero();
  return A;
}

TEST(ShapeChange, IsTheDifferenceOfTheMatricesInFewColumns) {
  for (const bool opens : {true, false}) {
    TissueModel model = by_hand::box_with_room(4, {1, 40});
    TissueState state = oracle::deformed(model, 2);
    const SystemMatrix law(model, node_graph(model), oracle::h);
    const MatX before = dense(model, state);
    const int node = oracle::nearest(model, 0.5 * oracle::size, 1).front();
    const int other = oracle::nearest(model, 0.5 * oracle::size, 2).back();
    const std::vector<int> tets = opens ? by_hand::open_node(model, state, node, Vec3(1, 0.2, 0.1))
                                        : by_hand::split_edge(model, state, node, other);
    ASSERT_GT(tets.size(), 4u);
    std::vector<SignedElement> elements;
    for (const int t : tets) {
      if (law.elements()[t].node != no_tet) elements.push_back({law.elements()[t], state.rotation[t], -1});
      elements.push_back({element_of(model, t), state.rotation[t], 1});
    }
    const ShapeChange change = shape_change(law, model.fixed, elements);
    const std::vector<int> dofs = oracle::dofs_of(change.nodes);
    const MatX expected = (dense(model, state) - before)(dofs, dofs);
    const MatX found =
        change.added * change.added.transpose() - change.taken_out * change.taken_out.transpose();
    EXPECT_LT((found - expected).norm(), 1e-13 * before.norm());
    // The rows of the two nodes; of the three, where the old ones change in mass alone.
    EXPECT_LE(change.added.cols() + change.taken_out.cols(), opens ? 12 : 18);
  }
}

}  // namespace
}  // namespace hapticd
