#include "physics/compliance/factor/front_plan.h"

#include <gtest/gtest.h>

#include <set>

#include "physics/compliance/factor/front_kernels.h"
#include "tests/physics/compliance/oracle.h"

namespace hapticd {
namespace {

FrontPlan plan_of(const TissueModel& model, int zone) {
  const NodeGraph graph = node_graph(model);
  const SystemMatrix matrix(model, graph, oracle::h);
  const std::vector<int> nodes = oracle::nearest(model, oracle::size, zone);
  return plan_fronts(matrix, zone_last_order(graph, fill_reducing_order(graph), nodes), {}, zone);
}

// The unknown of a front's row.
int unknown(const FrontPlan& plan, const FrontPlan::Front& front, int row) {
  return row < front.width ? front.first + row : plan.below[front.below + row - front.width];
}

TEST(FrontPlan, OneElementByHand) {
  TetMesh mesh;
  mesh.nodes = {{0, 0, 0}, {1e-3, 0, 0}, {0, 1e-3, 0}, {0, 0, 1e-3}};
  mesh.tets = {{0, 1, 2, 3}};
  const TissueModel model = make_tissue_model(std::move(mesh), {3000, 0.45, 1000, 0, 0}, {}, Vec3::Zero());
  const FrontPlan plan = plan_of(model, 1);
  ASSERT_EQ(plan.fronts.size(), 1U);
  EXPECT_EQ(plan.fronts[0].width, 12);
  EXPECT_EQ(plan.fronts[0].size, 12);
  EXPECT_EQ(plan.fronts[0].height, 16);
  EXPECT_EQ(plan.fronts[0].stride, 24);  // 16 is an even multiple of 8
  EXPECT_EQ(plan.values, 12 * 24);
  EXPECT_EQ(plan.workspace, 0);
  // Node k begins at 3 k columns of 24; below its own block are those of the nodes after it.
  std::set<std::ptrdiff_t> places;
  for (const FrontPlan::Coupling& coupling : plan.couplings) places.insert(coupling.to);
  EXPECT_EQ(places, (std::set<std::ptrdiff_t>{3, 6, 9, 72 + 6, 72 + 9, 144 + 9}));
}

TEST(FrontPlan, SquaresThatLiveTogetherDoNotOverlapAndChunksKeepTheirUnknowns) {
  for (const int zone : {0, 20, 60}) {
    const FrontPlan plan = plan_of(oracle::box(6), zone);
    std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> alive(plan.fronts.size());
    std::vector<int> living;
    int child = 0;
    for (int s = 0; s < static_cast<int>(plan.fronts.size()); ++s) {
      const FrontPlan::Front& front = plan.fronts[s];
      const std::ptrdiff_t end = front.contribution + front.contribution_stride * (front.size - front.width);
      EXPECT_LE(end, plan.workspace);
      for (const int other : living)
        EXPECT_TRUE(end <= alive[other].first || front.contribution >= alive[other].second)
            << s << " " << other;
      for (; child < front.children_end; ++child) {
        const int c = plan.children[child];
        std::erase(living, c);
        const FrontPlan::Front& from = plan.fronts[c];
        int covered = 0;
        for (int k = c > 0 ? plan.fronts[c - 1].chunks_end : 0; k < from.chunks_end; ++k) {
          const FrontChunk& chunk = plan.chunks[k];
          EXPECT_EQ(chunk.row % row_multiple, 0);
          EXPECT_EQ(chunk.from, covered);
          for (int bit = 0; bit < row_multiple; ++bit)
            if ((chunk.mask >> bit & 1) != 0) {
              EXPECT_EQ(plan.below[from.below + covered], unknown(plan, front, chunk.row + bit));
              ++covered;
            }
        }
        EXPECT_EQ(covered, from.size - from.width);
      }
      alive[s] = {front.contribution, end};
      if (front.size > front.width) living.push_back(s);
    }
    EXPECT_TRUE(living.empty());
  }
}

}  // namespace
}  // namespace hapticd
