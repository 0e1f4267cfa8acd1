#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "physics/compliance/reference/warp_rotation.h"
#include "tests/physics/compliance/oracle.h"

namespace hapticd {
namespace {

using oracle::box;

// Pieces are followed through removals, mostly without finding them anew: the turns stay those of fresh
// pieces.
TEST(WarpRotation, PiecesAreFollowedThroughRemovals) {
  const TissueModel model = box(4, 1, false);
  TissueState state = rest_state(model);
  WarpRotation followed(model);
  std::vector<int> order(model.tet_count());
  std::iota(order.begin(), order.end(), 0);
  std::mt19937 random(21);
  // Half in layers, which cuts, half at random.
  std::shuffle(order.begin() + 192, order.end(), random);
  std::vector<Mat3> Q, expected;
  for (std::size_t i = 0; i + 7 < order.size(); i += 7) {
    remove_tets(model, state, std::vector<int>(order.begin() + i, order.begin() + i + 7));
    for (Mat3& R : state.rotation) R = random_rotation(random);
    followed.all(Warping::piece, state, Q);
    WarpRotation fresh(model);
    fresh.all(Warping::piece, state, expected);
    for (int n = 0; n < model.node_count(); ++n)
      ASSERT_LT((Q[n] - expected[n]).norm(), 1e-9) << i << " " << n;
  }
}

}  // namespace
}  // namespace hapticd
